//! Any transfers as the stream of a USB3 Vision camera. Blocks come in order, none larger than was agreed; each that did not come whole says
//! so; and every one that is missing is counted once.
//!
//! | Bytes | Content |
//! |---|---|
//! | 2 | most bytes of a block |
//! | 1 | most bytes of a leader, in units of 8 |
//! | 2 for each transfer, then its bytes | its length in the low 14 bits; bit 14: blocks are taken after it; bit 15: none begins after it |

use erfgs_rig::genicam::{
    Block, Order, cut,
    u3v::stream::{Plan, Receiver},
};

use crate::memory;

/// Blocks that wait for being taken, and the one that is open.
const HELD: usize = 18;

#[derive(Default)]
struct Seen {
    handed: u64,
    missing: u64,
    numbers: Option<[u64; 2]>,
}

impl Seen {
    fn look(&mut self, block: &Block, plan: Plan) {
        assert!(block.bytes.len() <= plan.block_bytes && block.leader.is_some());
        match block.damage {
            Some(_) => assert_eq!(block.bytes.len(), plan.block_bytes),
            None => assert_eq!(block.missing, 0),
        }
        self.handed += 1;
        self.missing += u64::from(block.missing);
        let [first, last] = self.numbers.get_or_insert([block.number, block.number]);
        assert!(block.number > *last || self.handed == 1, "{} comes after {last}", block.number);
        assert!(*first <= block.number);
        *last = block.number;
        for order in [Order::Big, Order::Little] {
            let Some(chunks) = cut(&block.bytes, order) else { continue };
            let parts: usize = chunks.iter().map(|chunk| chunk.data.len() + 8).sum();
            assert_eq!(parts, block.bytes.len());
        }
    }
}

/// Checks one input.
pub fn u3vstream(input: &[u8]) {
    let Some((&[low, high, leader], mut rest)) = input.split_first_chunk() else { return };
    let plan = Plan { block_bytes: u16::from_le_bytes([low, high]).into(), leader_bytes: usize::from(leader) * 8 };
    let (mut seen, mut counts) = (Seen::default(), None);
    let peak = memory::peak(|| {
        let mut receiver = Receiver::new(plan);
        let mut now_ns = 0;
        while let Some((&head, after)) = rest.split_first_chunk() {
            let head = u16::from_le_bytes(head);
            let (transfer, after) = after.split_at(usize::from(head & 0x3fff).min(after.len()));
            rest = after;
            now_ns += 1;
            receiver.take(transfer, now_ns);
            if head >> 14 & 1 == 1 {
                while let Some(block) = receiver.next_block() {
                    seen.look(&block, plan);
                }
            }
            if head >> 15 == 1 {
                receiver.end();
            }
        }
        receiver.finish();
        while let Some(block) = receiver.next_block() {
            seen.look(&block, plan);
        }
        assert!(!receiver.is_busy());
        counts = Some(receiver.counts());
    });
    let Some(counts) = counts else { return };
    let span = seen.numbers.map_or(0, |[first, last]| last - first + 1);
    if counts.untaken == 0 {
        assert_eq!((span, counts.missing), (seen.handed + counts.lost, seen.missing));
    } else {
        // Those that nobody took may be behind the last that was.
        assert!(span <= seen.handed + counts.lost && counts.untaken <= counts.lost);
    }
    let limit = (64 << 10) + HELD * plan.block_bytes + 64 * input.len();
    assert!(peak <= limit, "{peak} bytes of memory for blocks of {} bytes", plan.block_bytes);
}
