use proptest::prelude::*;

use super::*;

const MS: i64 = 1_000_000;
const SLOT: usize = 16;
const BYTES: usize = 100;
const PACKETS: u32 = 7;

fn plan(resend: bool) -> Plan {
    Plan { datagram_bytes: SLOT + 8, block_bytes: BYTES, resend, timing: Timing::default() }
}

fn header(block: u16, format: u8, packet: u32) -> Vec<u8> {
    [&[0, 0][..], &block.to_be_bytes(), &(u32::from(format) << 24 | packet).to_be_bytes()].concat()
}

fn picture(block: u16) -> Vec<u8> {
    (0..BYTES).map(|at| (at as u16 ^ block.wrapping_mul(31)) as u8).collect()
}

/// Leader, payload and trailer of a block.
fn datagrams(block: u16) -> Vec<Vec<u8>> {
    let mut leader = header(block, 1, 0);
    leader.extend([0, 0, 0, 1, 0, 0, 0, 0, 0, 0]);
    leader.extend(block.to_be_bytes());
    leader.extend(0x0108_0001_u32.to_be_bytes());
    leader.extend([0, 0, 0, 10, 0, 0, 0, 10, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0]);
    let mut all = vec![leader];
    for (index, piece) in picture(block).chunks(SLOT).enumerate() {
        all.push([header(block, 3, index as u32 + 1), piece.to_vec()].concat());
    }
    all.push([header(block, 2, PACKETS + 1), vec![0, 0, 0, 1, 0, 0, 0, 10]].concat());
    all
}

fn drain(receiver: &mut Receiver) -> Vec<Block> {
    std::iter::from_fn(|| receiver.next_block()).collect()
}

fn requests(receiver: &mut Receiver) -> Vec<Request> {
    std::iter::from_fn(|| receiver.next_request()).collect()
}

/// The block as its camera sent it.
fn ticks(block: &Block) -> Option<u64> {
    block.leader.map(|leader| leader.ticks)
}

#[test]
fn a_block_comes_out_whole_with_the_arrival_of_its_first_datagram() {
    let mut receiver = Receiver::new(plan(true));
    for (index, datagram) in datagrams(7).iter().enumerate() {
        receiver.take(datagram, 5 * MS + index as i64);
    }
    let blocks = drain(&mut receiver);
    let [block] = &blocks[..] else { panic!("{blocks:?}") };
    assert_eq!((block.first_ns, ticks(block), block.damage, block.missing), (5 * MS, Some(7), None, 0));
    assert_eq!(block.bytes, picture(7));
    assert_eq!(block.leader.unwrap().image, Some(Image { pixels: 0x0108_0001, size: [10, 10], row_padding: 0 }));
    assert_eq!(receiver.counts(), Counts::default());
    assert_eq!(receiver.wake_ns(), None);
}

#[test]
fn a_lost_packet_is_asked_for_after_a_millisecond_and_again_after_twenty() {
    let mut receiver = Receiver::new(plan(true));
    let all = datagrams(1);
    for index in [0, 1, 2, 5, 6, 7, 8] {
        receiver.take(&all[index], 0);
    }
    assert_eq!((receiver.wake_ns(), requests(&mut receiver)), (Some(MS), Vec::new()));
    receiver.advance(MS);
    let asked = Request { block: 1, packets: [3, 4], long_ids: false };
    assert_eq!(requests(&mut receiver), [asked]);
    receiver.take(&all[4], 2 * MS);
    assert_eq!(receiver.wake_ns(), Some(21 * MS));
    receiver.advance(21 * MS);
    assert_eq!(requests(&mut receiver), [Request { packets: [3, 3], ..asked }]);
    receiver.take(&all[3], 22 * MS);
    let block = receiver.next_block().unwrap();
    assert_eq!((block.damage, block.bytes), (None, picture(1)));
    assert_eq!(receiver.counts(), Counts { asked: 3, ..Counts::default() });
}

#[test]
fn a_block_without_an_end_is_asked_for_it_and_then_given_as_it_is() {
    let mut receiver = Receiver::new(plan(true));
    for datagram in &datagrams(1)[..6] {
        receiver.take(datagram, 0);
    }
    receiver.advance(9 * MS);
    assert!(requests(&mut receiver).is_empty());
    receiver.advance(10 * MS);
    assert_eq!(requests(&mut receiver), [Request { block: 1, packets: [6, 8], long_ids: false }]);
    receiver.advance(99 * MS);
    assert!(drain(&mut receiver).is_empty());
    receiver.advance(100 * MS);
    let block = receiver.next_block().unwrap();
    assert_eq!((block.damage, block.missing), (Some(Damage::Missing), 3));
    assert_eq!(block.bytes, [&picture(1)[..80], &[0; 20]].concat());
    assert_eq!(receiver.counts().missing, 3);
}

#[test]
fn at_the_end_what_has_begun_becomes_whole_and_nothing_begins() {
    let mut receiver = Receiver::new(plan(true));
    let all = datagrams(1);
    all[..4].iter().for_each(|datagram| receiver.take(datagram, 0));
    receiver.end();
    for datagram in datagrams(2).iter().chain(&all[4..]) {
        assert!(receiver.is_busy());
        receiver.take(datagram, MS);
    }
    assert!(!receiver.is_busy());
    receiver.finish();
    let blocks = drain(&mut receiver);
    assert_eq!(blocks.iter().map(|block| (ticks(block), block.damage)).collect::<Vec<_>>(), [(Some(1), None)]);
    assert_eq!(receiver.counts(), Counts::default());
    // Nor does the first.
    let mut receiver = Receiver::new(plan(true));
    receiver.end();
    all.iter().for_each(|datagram| receiver.take(datagram, 0));
    assert!(!receiver.is_busy() && receiver.next_block().is_none());
}

#[test]
fn a_trailer_alone_can_be_missing() {
    let mut receiver = Receiver::new(plan(false));
    for datagram in &datagrams(1)[..8] {
        receiver.take(datagram, 0);
    }
    for datagram in datagrams(2) {
        receiver.take(&datagram, 40 * MS);
    }
    receiver.advance(100 * MS);
    let blocks = drain(&mut receiver);
    assert_eq!(blocks.iter().map(|block| block.damage).collect::<Vec<_>>(), [Some(Damage::Missing), None]);
    assert_eq!(blocks[0].bytes, picture(1));
}

#[test]
fn blocks_of_which_nothing_came_are_counted_over_the_wrap_of_their_ids() {
    let mut receiver = Receiver::new(plan(true));
    for block in [65_533, 65_534, 2, 3] {
        for datagram in datagrams(block) {
            receiver.take(&datagram, i64::from(block));
        }
        receiver.advance(i64::from(block) + 10 * MS);
    }
    let blocks = drain(&mut receiver);
    assert_eq!(blocks.iter().map(|block| block.number as u32).collect::<Vec<_>>(), [0, 1, 4, 5]);
    assert_eq!(receiver.counts(), Counts { lost: 2, ..Counts::default() });
}

#[test]
fn a_camera_that_counts_anew_loses_nothing_and_is_told_of() {
    let mut receiver = Receiver::new(plan(true));
    for (at, block) in [900_u16, 901, 1, 2].into_iter().enumerate() {
        for datagram in datagrams(block) {
            receiver.take(&datagram, at as i64 * 20 * MS);
        }
    }
    let blocks = drain(&mut receiver);
    assert_eq!(blocks.iter().map(|block| block.restarted).collect::<Vec<_>>(), [false, false, true, false]);
    assert_eq!(blocks.iter().map(|block| block.number as u32).collect::<Vec<_>>(), [0, 1, 2, 3]);
    assert_eq!(receiver.counts(), Counts::default());
}

#[test]
fn packets_of_other_lengths_and_numbers_are_damage() {
    for wrong in [vec![1; SLOT + 1], vec![1; SLOT - 1]] {
        let mut receiver = Receiver::new(plan(false));
        for (index, datagram) in datagrams(1).into_iter().enumerate() {
            let datagram = if index == 2 { [header(1, 3, 2), wrong.clone()].concat() } else { datagram };
            receiver.take(&datagram, 0);
        }
        receiver.advance(100 * MS);
        assert_eq!(receiver.next_block().unwrap().damage, Some(Damage::Layout), "{} bytes", wrong.len());
    }
    let mut receiver = Receiver::new(plan(false));
    for datagram in datagrams(1) {
        receiver.take(&datagram, 0);
        receiver.take(&[header(1, 3, 8 + 1), vec![1]].concat(), 0);
    }
    receiver.advance(100 * MS);
    assert_eq!(receiver.next_block().unwrap().damage, Some(Damage::Layout));
}

#[test]
fn what_the_camera_says_of_a_trailer_marks_the_block_and_of_a_packet_does_not() {
    let mut receiver = Receiver::new(plan(true));
    let all = datagrams(1);
    let mut gone = header(1, 3, 4);
    gone[..2].copy_from_slice(&[0x80, 0x10]);
    receiver.take(&gone, 0);
    for datagram in &all {
        receiver.take(datagram, 0);
    }
    assert_eq!(receiver.next_block().unwrap().damage, None);
    for datagram in datagrams(2) {
        let status = if datagram[4] == 2 { [0x80, 0x0d] } else { [0, 0] };
        receiver.take(&[&status, &datagram[2..]].concat(), 0);
    }
    assert_eq!(receiver.next_block().unwrap().damage, Some(Damage::Camera(0x800d)));
}

/// What happens to a datagram on its way.
#[derive(Clone, Copy, Debug)]
struct Way {
    lost: bool,
    twice: bool,
    /// By so many others it is overtaken.
    behind: usize,
}

fn ways(loss: f64) -> impl Strategy<Value = Vec<Way>> {
    let way = (prop::bool::weighted(loss), prop::bool::weighted(0.05), 0_usize..4);
    prop::collection::vec(way.prop_map(|(lost, twice, behind)| Way { lost, twice, behind }), 9 * 12)
}

/// Sends what was asked for, or does not.
fn answer(receiver: &mut Receiver, now_ns: i64, answers: bool) {
    for request in requests(receiver).into_iter().filter(|_| answers) {
        for packet in request.packets[0]..=request.packets[1] {
            receiver.take(&datagrams(request.block as u16)[packet as usize], now_ns);
        }
    }
}

/// Sends blocks 1 to 12 over a bad way; what is asked for comes if `answers` says so.
fn send(receiver: &mut Receiver, ways: &[Way], answers: bool) -> Vec<Block> {
    let sent: Vec<Vec<u8>> = (1..=12).flat_map(datagrams).collect();
    let mut order: Vec<(usize, usize)> = Vec::new();
    for (index, way) in ways.iter().enumerate().filter(|(_, way)| !way.lost) {
        order.push((index + way.behind, index));
        if way.twice {
            order.push((index + way.behind + 1, index));
        }
    }
    order.sort_by_key(|&(at, _)| at);
    let mut blocks = Vec::new();
    let mut now_ns = 0;
    for (at, index) in order {
        now_ns = at as i64 * MS / 10;
        receiver.take(&sent[index], now_ns);
        answer(receiver, now_ns, answers);
        blocks.extend(drain(receiver));
    }
    for _ in 0..30 {
        answer(receiver, now_ns, answers);
        now_ns += 5 * MS;
        receiver.advance(now_ns);
        blocks.extend(drain(receiver));
    }
    receiver.finish();
    blocks.extend(drain(receiver));
    blocks
}

proptest! {
    #[test]
    fn every_block_and_packet_is_there_or_counted_once(ways in ways(0.1)) {
        let mut receiver = Receiver::new(plan(false));
        let blocks = send(&mut receiver, &ways, false);
        let numbers: Vec<u32> = blocks.iter().map(|block| block.number as u32).collect();
        prop_assert!(numbers.is_sorted_by(|a, b| a < b), "{numbers:?}");
        let mut missing = 0;
        for block in &blocks {
            // Numbers are counted from the first block of which anything came.
            let first = ways.chunks(9).position(|ways| ways.iter().any(|way| !way.lost)).unwrap();
            let index = block.number as u32 as usize + first;
            let lost: Vec<usize> = (0..9).filter(|&packet| ways[9 * index + packet].lost).collect();
            prop_assert_eq!(block.missing as usize, lost.len());
            prop_assert_eq!(block.damage.is_none(), lost.is_empty());
            missing += lost.len();
            let mut expected = picture(index as u16 + 1);
            for packet in lost.into_iter().filter(|packet| (1..8).contains(packet)) {
                expected[(packet - 1) * SLOT..(packet * SLOT).min(BYTES)].fill(0);
            }
            prop_assert_eq!(&block.bytes, &expected);
        }
        prop_assert_eq!(receiver.counts().missing as usize, missing);
        prop_assert_eq!(receiver.counts().lost as usize + blocks.len(), numbers.last().map_or(0, |last| *last as usize + 1));
    }

    #[test]
    fn what_is_asked_for_and_comes_makes_all_blocks_whole(ways in ways(0.02)) {
        // Of the first blocks something has to come, so that they are known of; nobody asks for what nothing is known of.
        let known = ways.chunks(9).all(|ways| ways.iter().filter(|way| way.lost).count() <= 2);
        prop_assume!(known);
        let mut receiver = Receiver::new(plan(true));
        let blocks = send(&mut receiver, &ways, true);
        prop_assert_eq!(blocks.len(), 12);
        for (index, block) in blocks.iter().enumerate() {
            prop_assert_eq!(block.damage, None);
            prop_assert_eq!(&block.bytes, &picture(index as u16 + 1));
        }
        prop_assert_eq!(receiver.counts().missing, 0);
    }

    #[test]
    fn no_datagrams_make_it_panic_or_keep_much(
        input in prop::collection::vec((prop::collection::vec(any::<u8>(), 0..40), 0..200_i64), 0..60),
        mutations in prop::collection::vec((0_usize..108, 0_usize..24, any::<u8>()), 0..20),
    ) {
        let mut receiver = Receiver::new(plan(true));
        let mut sent: Vec<Vec<u8>> = (1..=12).flat_map(datagrams).collect();
        for (index, at, byte) in mutations {
            if let Some(place) = sent[index].get_mut(at) {
                *place ^= byte;
            }
        }
        let mut now_ns = 0;
        for (bytes, after_ms) in input.into_iter().chain(sent.into_iter().map(|sent| (sent, 0))) {
            now_ns += after_ms * MS;
            receiver.take(&bytes, now_ns);
            receiver.advance(now_ns);
            prop_assert!(receiver.open.len() <= MOST_OPEN);
            prop_assert!(receiver.wake_ns().is_none_or(|wake| wake > now_ns));
            for block in drain(&mut receiver) {
                prop_assert!(block.bytes.len() <= BYTES);
            }
            prop_assert!(requests(&mut receiver).len() <= 32);
        }
    }
}
