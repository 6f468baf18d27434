//! Sets of things that are tied together (union-find).

/// Which of `count` things are tied together, directly or through others.
#[derive(Clone, Debug)]
pub struct Forest {
    parent: Vec<usize>,
}

impl Forest {
    /// `count` things, each alone.
    #[must_use]
    pub fn new(count: usize) -> Self {
        Self { parent: (0..count).collect() }
    }

    /// Ties two things together; whether they were not tied before.
    pub fn tie(&mut self, a: usize, b: usize) -> bool {
        let (a, b) = (self.root(a), self.root(b));
        self.parent[a.max(b)] = a.min(b);
        a != b
    }

    /// Whether two things are tied together.
    #[must_use]
    pub fn tied(&self, a: usize, b: usize) -> bool {
        self.root(a) == self.root(b)
    }

    /// The groups, each in order, ordered by their first member.
    #[must_use]
    pub fn groups(&self) -> Vec<Vec<usize>> {
        let mut groups: Vec<Vec<usize>> = vec![Vec::new(); self.parent.len()];
        for thing in 0..self.parent.len() {
            groups[self.root(thing)].push(thing);
        }
        groups.retain(|group| !group.is_empty());
        groups
    }

    fn root(&self, mut thing: usize) -> usize {
        while self.parent[thing] != thing {
            thing = self.parent[thing];
        }
        thing
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ties_join_groups() {
        let mut forest = Forest::new(6);
        assert!(forest.tie(4, 2) && forest.tie(5, 0) && forest.tie(2, 1));
        assert!(!forest.tie(1, 4));
        assert!(forest.tied(1, 4) && !forest.tied(0, 1));
        assert_eq!(forest.groups(), [vec![0, 5], vec![1, 2, 4], vec![3]]);
    }
}
