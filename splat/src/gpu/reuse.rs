//! Bind groups and uniforms of one iteration that the next asks for again: making them takes the host longer than recording what they
//! are for.

use std::{
    collections::HashMap,
    hash::Hash,
    sync::{Mutex, MutexGuard, PoisonError},
};

use wgpu::{BindGroup, Buffer};

/// As many groups are kept of those asked for last, and at most as many again of those before: what one iteration draws from each of a dozen
/// cameras has its own.
const GROUPS: usize = 1024;
/// The same of uniforms.
const UNIFORMS: usize = 256;
/// A bind group keeps its buffers in memory. Before buffers of so many bytes have been made, all groups are forgotten.
const STALE: u64 = 64 << 20;

/// What may be asked for again.
#[derive(Debug, Default)]
pub(super) struct Reused(Mutex<Kept>);

#[derive(Debug, Default)]
struct Kept {
    /// By kernel and buffers.
    groups: Recent<(u64, Vec<Buffer>), BindGroup, GROUPS>,
    /// By name and bytes, which nothing changes.
    uniforms: Recent<(String, Vec<u8>), Buffer, UNIFORMS>,
    /// Bytes of the buffers that were made since groups were forgotten.
    made: u64,
}

impl Reused {
    /// The group of this kernel and these buffers.
    pub(super) fn group(&self, kernel: u64, buffers: &[&Buffer], make: impl FnOnce() -> BindGroup) -> BindGroup {
        let key = (kernel, buffers.iter().map(|&buffer| buffer.clone()).collect());
        self.lock().groups.get(key, make)
    }

    /// The uniform of this name and these bytes.
    pub(super) fn uniform(&self, label: &str, bytes: &[u8], make: impl FnOnce() -> Buffer) -> Buffer {
        self.lock().uniforms.get((label.to_owned(), bytes.to_vec()), make)
    }

    /// Lets go of all groups.
    pub(super) fn forget(&self) {
        let mut kept = self.lock();
        (kept.made, kept.groups) = (0, Recent::default());
    }

    /// Told before a buffer of `bytes` bytes is made.
    pub(super) fn makes(&self, bytes: u64) {
        let mut kept = self.lock();
        kept.made = kept.made.saturating_add(bytes);
        if kept.made >= STALE {
            (kept.made, kept.groups) = (0, Recent::default());
        }
    }

    fn lock(&self) -> MutexGuard<'_, Kept> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// What was asked for last: the `MOST` last ones for certain.
#[derive(Debug)]
struct Recent<K, V, const MOST: usize> {
    now: HashMap<K, V>,
    before: HashMap<K, V>,
}

impl<K, V, const MOST: usize> Default for Recent<K, V, MOST> {
    fn default() -> Self {
        Self { now: HashMap::new(), before: HashMap::new() }
    }
}

impl<K: Hash + Eq, V: Clone, const MOST: usize> Recent<K, V, MOST> {
    fn get(&mut self, key: K, make: impl FnOnce() -> V) -> V {
        if let Some(value) = self.now.get(&key) {
            return value.clone();
        }
        let value = self.before.remove(&key).unwrap_or_else(make);
        if self.now.len() >= MOST {
            self.before = std::mem::take(&mut self.now);
        }
        self.now.insert(key, value.clone());
        value
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gpu::{AdapterChoice, Gpu};

    #[test]
    fn what_is_asked_for_again_stays_while_other_things_pass() {
        const MOST: usize = 30;
        let (mut recent, mut made) = (Recent::<usize, usize, MOST>::default(), 0);
        let mut get = |key: usize| {
            recent.get(key, || {
                made += 1;
                key
            })
        };
        for other in 1..10 * MOST {
            assert_eq!((get(0), get(other)), (0, other));
        }
        assert_eq!(made, 10 * MOST, "each once");
        assert!(recent.now.len() <= MOST && recent.before.len() <= MOST);
    }

    #[test]
    fn uniforms_differ_where_their_bytes_do_and_groups_let_go_of_buffers() {
        let gpu = Gpu::open(&AdapterChoice::default()).expect("an adapter");
        let [one, same, other] = [1_u32, 1, 2].map(|value| gpu.uniform("numbers", &[value, 0, 0, 0]));
        assert!(one == same && one != other && one != gpu.uniform("others", &[1, 0, 0, 0]));
        let text = "@group(0) @binding(0) var<uniform> by: vec4u;
            @group(0) @binding(1) var<storage, read_write> sums: array<u32>;
            @compute @workgroup_size(1) fn main() { sums[0] += by.x; }";
        let kernels = [gpu.kernel("add", &[text]), gpu.kernel("add as well", &[text])];
        let sums = [gpu.storage("sums", 16).expect("room"), gpu.storage("other sums", 16).expect("room")];
        let run = |kernel: usize, by: &Buffer, sums: &Buffer| {
            let mut commands = gpu.commands();
            commands.dispatch(&kernels[kernel], &[by, sums], 1);
            commands.submit();
        };
        let groups = || gpu.reused.lock().groups.now.len();
        for _ in 0..3 {
            run(0, &one, &sums[0]);
            run(1, &other, &sums[1]);
            run(0, &other, &sums[1]);
        }
        assert_eq!(groups(), 3);
        let read = |sums: &Buffer| gpu.download::<u32>(sums, 1).expect("a sum")[0];
        assert_eq!([read(&sums[0]), read(&sums[1])], [3, 12]);
        let large = gpu.storage("large", STALE - 1).expect("room");
        assert_eq!(groups(), 0, "{} bytes", large.size());
        run(0, &one, &sums[0]);
        assert_eq!((groups(), read(&sums[0])), (1, 4));
    }
}
