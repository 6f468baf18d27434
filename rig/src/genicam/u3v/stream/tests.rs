use proptest::prelude::*;

use super::*;

const PLAN: Plan = Plan { block_bytes: 5000, leader_bytes: 1024 };

fn leader_of(id: u64) -> Vec<u8> {
    let mut bytes = b"U3VL\0\0\x34\0".to_vec();
    bytes.extend(id.to_le_bytes());
    bytes.extend([0, 0, 1, 0]);
    bytes.extend(id.wrapping_mul(1000).to_le_bytes());
    for word in [0x0108_0001_u32, 100, 50, 0, 0, 0] {
        bytes.extend(word.to_le_bytes());
    }
    bytes
}

fn trailer_of(id: u64, status: u16, valid: u64) -> Vec<u8> {
    let mut bytes = b"U3VT\0\0\x20\0".to_vec();
    bytes.extend(id.to_le_bytes());
    bytes.extend(status.to_le_bytes());
    bytes.extend([0, 0]);
    bytes.extend(valid.to_le_bytes());
    bytes.extend([50, 0, 0, 0]);
    bytes
}

fn payload(id: u64, bytes: usize) -> Vec<u8> {
    (0..bytes).map(|at| (at as u64 * 7).wrapping_add(id) as u8).collect()
}

/// The transfers of a whole block, of so many bytes at most.
fn transfers(id: u64, bytes: usize, transfer: usize) -> Vec<Vec<u8>> {
    let mut all = vec![leader_of(id)];
    all.extend(payload(id, bytes).chunks(transfer).map(<[u8]>::to_vec));
    let trailer = trailer_of(id, 0, bytes as u64);
    match all.last_mut().filter(|last| last.len() < transfer && last.len().is_multiple_of(1024)) {
        // Nothing tells the payload's end.
        Some(last) => last.extend(trailer),
        None => all.push(trailer),
    }
    all
}

fn take(receiver: &mut Receiver, transfers: &[Vec<u8>]) -> Vec<Block> {
    for (at, transfer) in transfers.iter().enumerate() {
        receiver.take(transfer, at as i64);
    }
    std::iter::from_fn(|| receiver.next_block()).collect()
}

#[test]
fn whole_blocks_come_out_as_they_were_sent_wherever_the_payload_ends() {
    for (bytes, transfer) in [(5000, 4096), (4096, 4096), (3072, 4096), (1, 4096), (5000, 1024), (4096, 8192)] {
        let mut receiver = Receiver::new(Plan { block_bytes: bytes, ..PLAN });
        let sent = [transfers(0, bytes, transfer), transfers(1, bytes, transfer)].concat();
        let blocks = take(&mut receiver, &sent);
        for (id, block) in blocks.iter().enumerate() {
            assert_eq!(block.bytes, payload(id as u64, bytes), "{bytes} of {transfer}");
            assert_eq!((block.number, block.damage, block.missing), (id as u64, None, 0));
            assert_eq!(block.leader.unwrap().ticks, id as u64 * 1000);
        }
        assert_eq!((blocks.len(), receiver.counts(), receiver.is_busy()), (2, Counts::default(), false));
    }
}

#[test]
fn what_is_missing_is_told_of_once() {
    let mut receiver = Receiver::new(PLAN);
    let mut sent = transfers(3, 5000, 2048);
    // A packet of the payload; all of block 4; the trailer of 5; the leader of 6.
    sent[1].drain(..1024);
    let [mut five, six] = [5, 6].map(|id| transfers(id, 5000, 2048));
    five.pop();
    let blocks = take(&mut receiver, &[sent, five, six[1..].to_vec(), transfers(7, 5000, 2048)].concat());
    let received: Vec<_> = blocks.iter().map(|block| (block.number, block.damage, block.missing)).collect();
    let missing = Some(Damage::Missing);
    assert_eq!(received[0], (3, missing, 1));
    // What came of 6 is behind 5, which had all of its own.
    assert_eq!(received[1], (5, Some(Damage::Layout), 1));
    assert_eq!(received[2..], [(7, None, 0)]);
    assert!(blocks.iter().all(|block| block.bytes.len() == 5000));
    assert_eq!(blocks[0].bytes[..1024], payload(3, 5000)[1024..2048]);
    let counts = Counts { lost: 2, missing: 2, endless: 1, ..Counts::default() };
    assert_eq!(receiver.counts(), counts);
}

#[test]
fn a_camera_that_lost_something_says_so() {
    let mut receiver = Receiver::new(PLAN);
    let sent = [leader_of(0), payload(0, 2500), trailer_of(0, 0xa101, 2500)];
    let blocks = take(&mut receiver, &sent);
    assert_eq!(blocks[0].damage, Some(Damage::Camera(0xa101)));
    assert_eq!((&blocks[0].bytes[..2500], blocks[0].bytes.len()), (&payload(0, 2500)[..], 5000));
    // A trailer that says more than there can be.
    let sent = [leader_of(1), payload(1, 5000), trailer_of(1, 0, u64::MAX)];
    assert_eq!(take(&mut receiver, &sent)[0].damage, Some(Damage::Layout));
    assert_eq!(receiver.counts().lost, 0);
}

#[test]
fn a_camera_that_counts_anew_loses_nothing() {
    let mut receiver = Receiver::new(PLAN);
    let sent = [100, 0, 1, u64::MAX].map(|id| transfers(id, 5000, 8192)).concat();
    let blocks = take(&mut receiver, &sent);
    let received: Vec<_> = blocks.iter().map(|block| (block.number, block.restarted)).collect();
    assert_eq!(received, [(100, false), (101, true), (102, false), (103, true)]);
    assert_eq!(receiver.counts(), Counts::default());
}

#[test]
fn blocks_that_nobody_takes_are_lost_and_no_memory_grows() {
    let mut receiver = Receiver::new(PLAN);
    let sent: Vec<_> = (0..100).flat_map(|id| transfers(id, 5000, 8192)).collect();
    assert_eq!(take(&mut receiver, &sent).len(), MOST_WAITING);
    let lost = 100 - MOST_WAITING as u64;
    assert_eq!((receiver.counts().lost, receiver.counts().untaken), (lost, lost));
}

#[test]
fn what_has_begun_ends_and_nothing_begins_when_a_stream_ends() {
    let mut receiver = Receiver::new(PLAN);
    let [first, second] = [0, 1].map(|id| transfers(id, 5000, 2048));
    assert!(take(&mut receiver, &first[..2]).is_empty() && receiver.is_busy());
    receiver.end();
    let blocks = take(&mut receiver, &[&first[2..], &second].concat());
    assert_eq!(blocks.iter().map(|block| (block.number, block.damage)).collect::<Vec<_>>(), [(0, None)]);
    assert!(!receiver.is_busy() && receiver.counts() == Counts::default());
}

/// What becomes of a transfer on its way.
#[derive(Clone, Debug)]
enum Way {
    Through,
    Lost,
    Cut(usize),
    Twice,
    Flipped(usize, u8),
    Noise(Vec<u8>),
}

fn way() -> impl Strategy<Value = Way> {
    prop_oneof![
        8 => Just(Way::Through),
        1 => Just(Way::Lost),
        1 => (0_usize..5000).prop_map(Way::Cut),
        1 => Just(Way::Twice),
        2 => (0_usize..60, 1_u8..).prop_map(|(at, bits)| Way::Flipped(at, bits)),
        1 => prop::collection::vec(any::<u8>(), 1..3000).prop_map(Way::Noise),
    ]
}

fn sent(ways: &[Way], transfers: Vec<Vec<u8>>) -> Vec<Vec<u8>> {
    let all = transfers.into_iter().enumerate().flat_map(|(at, mut transfer)| {
        match ways.get(at % ways.len().max(1)).unwrap_or(&Way::Through) {
            Way::Through => vec![transfer],
            Way::Lost => vec![],
            Way::Cut(bytes) => {
                transfer.truncate(*bytes);
                vec![transfer]
            }
            Way::Twice => vec![transfer.clone(), transfer],
            Way::Flipped(at, bits) => {
                let at = at % transfer.len();
                transfer[at] ^= bits;
                vec![transfer]
            }
            Way::Noise(bytes) => vec![bytes.clone(), transfer],
        }
    });
    all.filter(|transfer| !transfer.is_empty()).collect()
}

proptest! {
    #[test]
    fn whatever_comes_blocks_have_their_size_and_numbers_rise(
        ways in prop::collection::vec(way(), 1..40), bytes in 1_usize..5000, transfer in 1_usize..5
    ) {
        let plan = Plan { block_bytes: bytes, ..PLAN };
        let mut receiver = Receiver::new(plan);
        let all = (0..12).flat_map(|id| transfers(id, bytes, transfer * 1024)).collect();
        let mut blocks = take(&mut receiver, &sent(&ways, all));
        receiver.finish();
        blocks.extend(receiver.next_block());
        for pair in blocks.windows(2) {
            prop_assert!(pair[0].number < pair[1].number);
        }
        for block in &blocks {
            prop_assert!(block.bytes.len() <= bytes);
            prop_assert!(block.damage.is_none() || block.bytes.len() == bytes);
        }
    }

    /// Where nothing is made up, what is whole is what was sent, and every block is there or counted.
    #[test]
    fn what_is_lost_is_counted_and_nothing_else_is_changed(lost in prop::collection::vec(any::<bool>(), 48)) {
        let mut receiver = Receiver::new(PLAN);
        let all: Vec<_> = (0..12).flat_map(|id| transfers(id, 5000, 2048)).collect();
        let kept = all.into_iter().zip(lost.iter().cycle()).filter(|(_, lost)| !**lost).map(|(transfer, _)| transfer);
        let mut blocks = take(&mut receiver, &kept.collect::<Vec<_>>());
        receiver.finish();
        blocks.extend(receiver.next_block());
        for block in blocks.iter().filter(|block| block.damage.is_none()) {
            prop_assert_eq!(&block.bytes, &payload(block.number, 5000));
        }
        if let (Some(first), Some(last)) = (blocks.first(), blocks.last()) {
            prop_assert_eq!(blocks.len() as u64 + receiver.counts().lost, last.number - first.number + 1);
        }
    }
}
