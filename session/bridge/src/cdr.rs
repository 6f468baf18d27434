//! CDR as ROS 2 lays messages out: little-endian, every number at a multiple of its size.

/// How it begins; places are counted from behind it.
const ENCAPSULATION: [u8; 4] = [0, 1, 0, 0];

/// A message that is being written, field by field in the order of its definition.
#[derive(Clone, Debug)]
pub struct Cdr(Vec<u8>);

impl Cdr {
    /// A message without fields.
    pub fn new() -> Self {
        Self(ENCAPSULATION.to_vec())
    }

    /// Its bytes.
    pub fn into_bytes(self) -> Vec<u8> {
        self.0
    }

    fn align(&mut self, size: usize) {
        let filled = (self.0.len() - ENCAPSULATION.len()).next_multiple_of(size);
        self.0.resize(ENCAPSULATION.len() + filled, 0);
    }

    /// `uint8` and `bool`.
    pub fn u8(mut self, value: u8) -> Self {
        self.0.push(value);
        self
    }

    /// `int32`.
    pub fn i32(self, value: i32) -> Self {
        self.u32(value.cast_unsigned())
    }

    /// `uint32`.
    pub fn u32(mut self, value: u32) -> Self {
        self.align(4);
        self.0.extend(value.to_le_bytes());
        self
    }

    /// `uint64`.
    pub fn u64(mut self, value: u64) -> Self {
        self.align(8);
        self.0.extend(value.to_le_bytes());
        self
    }

    /// `float64[N]`, or each of several fields.
    pub fn doubles(self, values: &[f64]) -> Self {
        values.iter().fold(self, |cdr, value| cdr.u64(value.to_bits()))
    }

    /// `float64[]`.
    pub fn sequence(self, values: &[f64]) -> Self {
        self.u32(values.len() as u32).doubles(values)
    }

    /// `string`.
    pub fn text(self, value: &str) -> Self {
        let mut cdr = self.u32(value.len() as u32 + 1);
        cdr.0.extend(value.as_bytes());
        cdr.0.push(0);
        cdr
    }

    /// `uint8[]`.
    pub fn bytes(self, value: &[u8]) -> Self {
        let mut cdr = self.u32(value.len() as u32);
        cdr.0.extend(value);
        cdr
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_number_lies_at_a_multiple_of_its_size_behind_the_head() {
        let bytes = Cdr::new().u8(1).u32(2).u8(3).u64(4).text("ab").sequence(&[1.0]).bytes(&[7]).into_bytes();
        let expected: Vec<u8> = [
            &[0, 1, 0, 0][..],
            &[1, 0, 0, 0, 2, 0, 0, 0, 3, 0, 0, 0, 0, 0, 0, 0],
            &4_u64.to_le_bytes(),
            &[3, 0, 0, 0, b'a', b'b', 0, 0],
            &[1, 0, 0, 0, 0, 0, 0, 0][..4],
            &[0; 4],
            &1.0_f64.to_le_bytes(),
            &[1, 0, 0, 0, 7],
        ]
        .concat();
        assert_eq!(bytes, expected);
    }
}
