//! What was used last, within a bound.

use std::collections::HashMap;

/// Values by key that take no more than so many bytes, or are a single one. The least recently used go first.
#[derive(Debug)]
pub(super) struct Recent<T> {
    most: u64,
    held: u64,
    now: u64,
    entries: HashMap<usize, Entry<T>>,
}

#[derive(Debug)]
struct Entry<T> {
    value: T,
    bytes: u64,
    used: u64,
}

impl<T> Recent<T> {
    /// None yet, within so many bytes.
    pub fn new(most: u64) -> Self {
        Self { most, held: 0, now: 0, entries: HashMap::new() }
    }

    /// How many bytes may be held.
    pub fn most(&self) -> u64 {
        self.most
    }

    /// The value of a key, which has been used now.
    pub fn get(&mut self, key: usize) -> Option<&T> {
        self.now += 1;
        let entry = self.entries.get_mut(&key)?;
        entry.used = self.now;
        Some(&entry.value)
    }

    /// Lets values go until there is room for so many bytes, or none is left.
    pub fn make_room(&mut self, bytes: u64) -> Vec<T> {
        let mut gone = Vec::new();
        while self.held.saturating_add(bytes) > self.most {
            let oldest = self.entries.iter().min_by_key(|(_, entry)| entry.used).map(|(&key, _)| key);
            let Some(entry) = oldest.and_then(|key| self.entries.remove(&key)) else { break };
            self.held -= entry.bytes;
            gone.push(entry.value);
        }
        gone
    }

    /// Holds a value from now on, for which room was made.
    pub fn put(&mut self, key: usize, bytes: u64, value: T) {
        let entry = Entry { value, bytes, used: self.now };
        self.held += bytes;
        if let Some(before) = self.entries.insert(key, entry) {
            self.held -= before.bytes;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_not_used_for_longest_goes_first() {
        let mut recent = Recent::new(30);
        let put = |recent: &mut Recent<char>, key: usize, bytes: u64, value: char| {
            let gone = recent.make_room(bytes);
            recent.put(key, bytes, value);
            gone
        };
        for (key, value) in ['a', 'b', 'c'].into_iter().enumerate() {
            assert_eq!(recent.get(key), None);
            assert!(put(&mut recent, key, 10, value).is_empty());
        }
        assert_eq!(recent.get(0), Some(&'a'));
        assert_eq!(put(&mut recent, 3, 15, 'd'), ['b', 'c']);
        assert_eq!([1, 0, 3].map(|key| recent.get(key).copied()), [None, Some('a'), Some('d')]);
        // Put again it counts once; what is larger than the bound is held alone.
        assert_eq!(put(&mut recent, 3, 15, 'e'), ['a']);
        assert_eq!((recent.held, recent.get(3).copied()), (15, Some('e')));
        assert_eq!(put(&mut recent, 4, 99, 'f'), ['e']);
        assert_eq!((recent.held, recent.entries.len(), recent.get(4).copied()), (99, 1, Some('f')));
        assert_eq!(put(&mut recent, 5, 1, 'g'), ['f']);
        assert_eq!(recent.held, 1);
    }
}
