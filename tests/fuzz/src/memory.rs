//! How much memory a piece of the program takes.
#![expect(unsafe_code, reason = "an allocator that counts has to be one")]

use std::{
    alloc::{GlobalAlloc, Layout, System},
    cell::Cell,
};

thread_local! {
    /// Bytes in use that this thread has asked for, less those that it gave back, others' included; and the most since
    /// [`peak`] began.
    static COUNTS: Cell<[isize; 2]> = const { Cell::new([0; 2]) };
}

/// The system's allocator, which counts.
struct Counting;

fn count(bytes: isize) {
    COUNTS.with(|counts| {
        let [live, peak] = counts.get();
        let live = live.wrapping_add(bytes);
        counts.set([live, peak.max(live)]);
    });
}

// SAFETY: all calls go to the system's allocator as they are; counting allocates nothing, as the counts need neither a
// constructor nor a destructor.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        count(layout.size().cast_signed());
        // SAFETY: the caller keeps the contract of `alloc`, which is the same.
        unsafe { System.alloc(layout) }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        count(layout.size().cast_signed());
        // SAFETY: the caller keeps the contract of `alloc_zeroed`, which is the same.
        unsafe { System.alloc_zeroed(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        count(-layout.size().cast_signed());
        // SAFETY: the caller keeps the contract of `dealloc`, which is the same.
        unsafe { System.dealloc(pointer, layout) }
    }

    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        // Both lie side by side where it moves.
        count(size.cast_signed());
        count(-layout.size().cast_signed());
        // SAFETY: the caller keeps the contract of `realloc`, which is the same.
        unsafe { System.realloc(pointer, layout, size) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// Bytes that were in use at once while `what` ran, beyond those in use before. Memory that is asked for and never touched
/// counts: a claim alone must not reserve it. What other threads take does not, so that tests may run side by side; nothing
/// that is checked here starts a thread.
pub fn peak<T>(what: impl FnOnce() -> T) -> usize {
    let before = COUNTS.with(|counts| {
        let [live, _] = counts.get();
        counts.set([live, live]);
        live
    });
    let result = what();
    let [_, peak] = COUNTS.with(Cell::get);
    drop(result);
    peak.wrapping_sub(before).max(0).cast_unsigned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn memory_that_is_asked_for_counts_while_it_is_held_and_that_of_other_threads_does_not() {
        assert_eq!(peak(|| ()), 0);
        let vector = |megabytes: usize| Vec::<u8>::with_capacity(megabytes << 20);
        assert_eq!(peak(|| vector(3)), 3 << 20);
        let one_after_the_other = peak(|| {
            drop(vector(3));
            vector(5)
        });
        assert_eq!(one_after_the_other, 5 << 20);
        assert_eq!(peak(|| (vector(3), vector(5))), 8 << 20, "at once");
        assert_eq!(peak(|| vec![0_u8; 1 << 20]), 1 << 20);
        let grown = peak(|| {
            let mut bytes = vector(1);
            bytes.reserve_exact(2 << 20);
            bytes
        });
        assert_eq!(grown, 3 << 20);
        let elsewhere = peak(|| std::thread::spawn(move || drop(vector(7))).join());
        assert!(elsewhere < 1 << 20, "{elsewhere}");
    }
}
