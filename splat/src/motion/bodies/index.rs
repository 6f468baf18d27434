//! Which Gaussians hang on which body and node, so that what they say can be added up in a fixed order.

/// Shares of a row: one of its body, four of its nodes.
const SHARES: u32 = 5;
/// Shares that are added up at a time.
const CHUNK: usize = 256;

/// Shares of each body and node, in chunks.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Index {
    /// Shares, those of each body and node in a row.
    pub items: Vec<u32>,
    /// First item and items of each chunk.
    pub chunks: Vec<[u32; 2]>,
    /// First chunk and chunks of each body and node.
    pub runs: Vec<[u32; 2]>,
    /// Whether some rows are of no body.
    pub some_are_free: bool,
}

impl Index {
    /// The most shares, and the most chunks of them, that so many rows have on so many bodies and nodes.
    #[must_use]
    pub fn most(entities: usize, rows: usize) -> [usize; 2] {
        let items = rows * SHARES as usize;
        // The last chunk of each may be short.
        [items, items / CHUNK + entities]
    }

    /// The index of rows of `floats` floats, of which those from `first` on name body and nodes (`row.wgsl`).
    #[must_use]
    pub fn new(rows: &[f32], floats: usize, first: usize, bodies: usize, nodes: usize) -> Self {
        let mut lists: Vec<Vec<u32>> = vec![Vec::new(); bodies + nodes];
        let mut some_are_free = false;
        for (row, values) in rows.chunks_exact(floats.max(1)).enumerate() {
            let body = values[first] as usize;
            some_are_free |= body == 0;
            if (1..=bodies).contains(&body) {
                let ids = std::iter::once(body - 1).chain(
                    values[first + 1..first + 5]
                        .iter()
                        .map(|node| *node as usize)
                        .map_while(|node| (1..=nodes).contains(&node).then(|| bodies + node - 1)),
                );
                for (slot, entity) in ids.enumerate() {
                    lists[entity].push(SHARES * row as u32 + slot as u32);
                }
            }
        }
        let mut index = Self { some_are_free, ..Self::default() };
        for list in lists {
            let begin = index.chunks.len() as u32;
            for chunk in list.chunks(CHUNK) {
                index.chunks.push([index.items.len() as u32, chunk.len() as u32]);
                index.items.extend(chunk);
            }
            index.runs.push([begin, index.chunks.len() as u32 - begin]);
        }
        index
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_share_is_in_the_run_of_its_body_or_node_once() {
        // Rows of 6 floats: one of their path, then body and nodes.
        let rows = |count: usize| -> Vec<f32> {
            (0..count)
                .flat_map(|row| match row % 3 {
                    0 => [9.0, 1.0, 1.0, 2.0, 0.0, 0.0],
                    1 => [9.0, 2.0, 3.0, 0.0, 0.0, 0.0],
                    _ => [9.0, 0.0, 0.0, 0.0, 0.0, 0.0],
                })
                .collect()
        };
        let index = Index::new(&rows(2400), 6, 1, 2, 3);
        assert!(index.some_are_free);
        assert_eq!(index.runs.len(), 5);
        let of = |entity: usize| -> Vec<u32> {
            let [first, count] = index.runs[entity].map(|at| at as usize);
            let chunks = &index.chunks[first..first + count];
            chunks.iter().flat_map(|&[at, items]| index.items[at as usize..(at + items) as usize].to_vec()).collect()
        };
        assert!(index.chunks.iter().all(|[_, items]| *items as usize <= CHUNK));
        let expected = |slot: u32, kind: u32| (0..800).map(|k| SHARES * (3 * k + kind) + slot).collect::<Vec<u32>>();
        assert_eq!([of(0), of(1)], [expected(0, 0), expected(0, 1)]);
        assert_eq!([of(2), of(3), of(4)], [expected(1, 0), expected(2, 0), expected(1, 1)]);
    }

    #[test]
    fn rows_that_name_nobody_there_is_are_left_out() {
        let index = Index::new(&[7.0, 9.0, 0.0, 0.0, 0.0, f32::NAN, 1.0, 0.0, 0.0, 0.0], 5, 0, 2, 1);
        assert_eq!(index.runs, [[0, 0], [0, 0], [0, 0]]);
        assert_eq!(Index::new(&[], 16, 8, 0, 0), Index::default());
    }
}
