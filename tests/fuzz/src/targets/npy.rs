//! Any bytes as an array of NumPy. What is read as integers is written as an array that reads the same.

use erfgs_base::npy::{self, NpyArray};

use crate::memory;

/// Checks one input.
pub fn npy(bytes: &[u8]) {
    let peak = memory::peak(|| {
        for (_, column) in npy::decode_records(bytes).unwrap_or_default() {
            assert!(column.shape == [column.len()]);
        }
        let Ok(array) = NpyArray::decode(bytes) else { return };
        let elements = array.shape.iter().try_fold(1_usize, |all, &length| all.checked_mul(length));
        assert!(array.is_empty() || elements == Some(array.len()), "{:?} and {}", array.shape, array.len());
        if let Ok(values) = array.integers::<i64>("i64") {
            assert_eq!(values.len(), array.len());
            // Axes of an array without values may be of any length, which is not so for every type.
            if !values.is_empty() && array.shape.len() < 1000 {
                let written = npy::encode(&array.shape, values.iter().copied());
                let read = NpyArray::decode(&written).expect("what was written");
                assert_eq!(read.shape, array.shape);
                assert_eq!(read.integers::<i64>("i64").expect("integers"), values);
            }
        }
        let _ = array.integers::<u16>("u16");
        let _ = array.floats();
        let _ = array.into_bytes();
    });
    let limit = (64 << 10) + 128 * bytes.len();
    assert!(peak <= limit, "{peak} bytes of memory for an array of {} bytes", bytes.len());
}
