//! Chunks behind an image: what the camera measured of that frame. They are read from the end: data, its id, its length.

/// Which way numbers lie.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Order {
    /// GigE Vision.
    Big,
    /// USB3 Vision.
    Little,
}

/// A chunk.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Chunk<'a> {
    /// Its id; each camera has its own, which its description tells.
    pub id: u32,
    /// Its bytes.
    pub data: &'a [u8],
}

/// More than this no camera sends.
const MOST: usize = 64;

/// Takes a block apart: its chunks, the first (which is the image) first. `None` if it is not made of chunks.
#[must_use]
pub fn cut(mut block: &[u8], order: Order) -> Option<Vec<Chunk<'_>>> {
    let mut chunks = Vec::new();
    while !block.is_empty() {
        let (rest, tag) = block.split_last_chunk::<8>()?;
        let word = |bytes: [u8; 4]| match order {
            Order::Big => u32::from_be_bytes(bytes),
            Order::Little => u32::from_le_bytes(bytes),
        };
        let [a, b, c, d, e, f, g, h] = *tag;
        let (id, length) = (word([a, b, c, d]), word([e, f, g, h]) as usize);
        let (before, data) = rest.split_at_checked(rest.len().checked_sub(length)?)?;
        chunks.push(Chunk { id, data });
        if chunks.len() > MOST {
            return None;
        }
        block = before;
    }
    chunks.reverse();
    Some(chunks)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn chunks_are_read_from_the_end() {
        let block = [9, 8, 7, 6, 0, 0, 0, 1, 0, 0, 0, 4, 0xaa, 0xbb, 0, 0, 1, 2, 0, 0, 0, 2];
        let chunks = cut(&block, Order::Big).unwrap();
        assert_eq!(chunks, [Chunk { id: 1, data: &[9, 8, 7, 6] }, Chunk { id: 0x102, data: &[0xaa, 0xbb] }]);
        assert_eq!(cut(&block[1..], Order::Big), None);
        assert_eq!(cut(&block, Order::Little), None);
        assert_eq!(cut(&[], Order::Big), Some(Vec::new()));
    }

    proptest! {
        #[test]
        fn what_is_cut_is_what_was_put_together(parts in prop::collection::vec((any::<u32>(), prop::collection::vec(any::<u8>(), 0..20)), 0..8)) {
            let mut block = Vec::new();
            for (id, data) in &parts {
                block.extend(data);
                block.extend(id.to_le_bytes());
                block.extend((data.len() as u32).to_le_bytes());
            }
            let chunks = cut(&block, Order::Little).unwrap();
            let back: Vec<_> = chunks.iter().map(|chunk| (chunk.id, chunk.data.to_vec())).collect();
            prop_assert_eq!(back, parts);
        }

        #[test]
        fn any_bytes_are_cut_or_refused(bytes in prop::collection::vec(any::<u8>(), 0..100)) {
            for order in [Order::Big, Order::Little] {
                let _ = cut(&bytes, order);
            }
        }
    }
}
