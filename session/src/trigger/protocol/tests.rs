use proptest::prelude::*;

use super::*;

fn read(bytes: &[u8]) -> (Vec<Message>, u64) {
    let mut reader = Reader::new();
    let mut messages = Vec::new();
    reader.push(bytes, |message| messages.push(message));
    (messages, reader.damaged())
}

fn identity() -> Identity {
    Identity { name: NAME.into(), version: 1, firmware: 3, tick_hz: TICK_HZ, outputs: 4 }
}

#[test]
fn the_checksum_is_crc_16_xmodem() {
    // The check value that catalogues of checksums give.
    assert_eq!(checksum(b"123456789"), 0x31c3);
    assert_eq!(checksum(b""), 0);
}

#[test]
fn commands_are_lines_with_checksums() {
    assert_eq!(Command::Period(533_333).to_string(), "period 82355");
    assert_eq!(Command::Leds([5, 0, 0xffff]).to_string(), "leds 5 0 ffff");
    let bytes = Command::Start.encode();
    assert_eq!(bytes, format!("start*{:04x}\n", checksum(b"start")).into_bytes());
}

#[test]
fn every_kind_of_line_is_read() {
    let status = Status {
        running: true,
        period: 0x8_2355,
        exposure: 0x1_3880,
        outputs: 0xf,
        count: 0x2a,
        tick: 0x1_2345_6789,
        lost_lines: 0,
        late_edges: 0,
        bad_lines: 2,
    };
    let cases = [
        ("b erfgs-trigger 1 3 f42400 4 2", Message::Boot { identity: identity(), cause: 2 }),
        ("p 2a 123456789abc 13880", Message::Pulse(Pulse { index: 42, tick: 0x1234_5678_9abc, width: 80_000 })),
        ("+identify erfgs-trigger 1 3 f42400 4", Message::Done(Reply::Identify(identity()))),
        ("+period 82355", Message::Done(Reply::Period(533_333))),
        ("+exposure 13880", Message::Done(Reply::Exposure(80_000))),
        ("+outputs f", Message::Done(Reply::Outputs(15))),
        ("+start ffffffffff", Message::Done(Reply::Start(0xff_ffff_ffff))),
        ("+stop 10", Message::Done(Reply::Stop(16))),
        ("+count 0", Message::Done(Reply::Count(0))),
        ("+leds 5 7 ffff", Message::Done(Reply::Leds([5, 7, 0xffff]))),
        ("+clock ffffffffffffffff 1", Message::Done(Reply::Clock { token: u64::MAX, tick: 1 })),
        ("+status 1 82355 13880 f 2a 123456789 0 0 2", Message::Done(Reply::Status(status))),
        ("-start 5", Message::Refused { command: "start".into(), error: Refusal::Running }),
        ("-? 1", Message::Refused { command: "?".into(), error: Refusal::Damaged }),
    ];
    for (body, expected) in cases {
        assert_eq!(read(&line(body)), (vec![expected], 0), "{body}");
    }
}

#[test]
fn lines_with_other_fields_are_damaged() {
    let first = line("+count 1");
    for body in [
        "",
        "p",
        "p 1 2",
        "p 1 2 3 4",
        "p 1  2 3",
        "p 1 2 3 ",
        "p 1 2 X",
        "p 1 2 A",
        "p 1 2 -3",
        "p 1 2 +3",
        "p 100000000 2 3",
        "q 1",
        "+count",
        "+bananas 1",
        "+status 2 1 1 1 1 1 1 1 1",
        "-start",
        "\u{fffd}",
    ] {
        let (messages, damaged) = read(&[first.clone(), line(body)].concat());
        assert_eq!((messages.len(), damaged), (1, 1), "{body:?}");
    }
}

#[test]
fn half_a_line_and_garbage_before_the_first_line_feed_are_no_damage() {
    let bytes = [b"\xff\x00 2 13880*1234\n".as_slice(), &line("p 1 2 3"), b"\r\n"].concat();
    let (messages, damaged) = read(&bytes);
    assert_eq!(messages, [Message::Pulse(Pulse { index: 1, tick: 2, width: 3 })]);
    assert_eq!(damaged, 0);
}

#[test]
fn an_endless_line_takes_no_memory_and_the_next_is_read() {
    let mut reader = Reader::new();
    for _ in 0..1000 {
        reader.push(&[b'x'; 1000], |_| panic!("there is no message"));
    }
    assert!(reader.line.capacity() <= 4 * LINE_MAX);
    let mut count = 0;
    reader.push(b"\n", |_| panic!("there is no message"));
    reader.push(&line("p 1 2 3"), |_| count += 1);
    assert_eq!(count, 1);
}

#[test]
fn parts_are_the_bytes_as_they_came_each_line_with_its_message() {
    let good = line("p 1 2 3");
    let bytes = [&b"half\n"[..], &good, &[b'x'; 200], b"\r\n", &good, b"rest"].concat();
    for size in [1, 7, 50, 1000] {
        let (mut reader, mut parts, mut messages) = (Reader::new(), Vec::new(), Vec::new());
        for piece in bytes.chunks(size) {
            reader.parts(piece, |part, message| {
                assert!(message.is_none() || part == good);
                parts.extend_from_slice(part);
                messages.extend(message);
            });
        }
        assert_eq!(parts, bytes[..bytes.len() - 4], "all but the line under way, cut at {size}");
        assert_eq!((messages.len(), reader.damaged()), (2, 1), "cut at {size}");
    }
}

proptest! {
    #[test]
    fn pulses_are_read_however_the_bytes_are_cut(
        pulses in prop::collection::vec((any::<u32>(), 0..1u64 << 48, any::<u32>()), 1..6),
        carriage_returns in any::<bool>(),
    ) {
        let pulses: Vec<_> = pulses.iter().map(|&(index, tick, width)| Pulse { index, tick, width }).collect();
        let mut bytes = Vec::new();
        for Pulse { index, tick, width } in &pulses {
            bytes.extend(line(&format!("p {index:x} {tick:x} {width:x}")));
            if carriage_returns {
                bytes.pop();
                bytes.extend(b"\r\n");
            }
        }
        for cut in 0..=bytes.len() {
            let mut reader = Reader::new();
            let mut found = Vec::new();
            for part in [&bytes[..cut], &bytes[cut..]] {
                reader.push(part, |message| if let Message::Pulse(pulse) = message { found.push(pulse) });
            }
            prop_assert_eq!(&found, &pulses);
            prop_assert_eq!(reader.damaged(), 0);
        }
    }

    #[test]
    fn any_one_wrong_byte_is_noticed(index in any::<u32>(), place in any::<prop::sample::Index>(), wrong in any::<u8>()) {
        let good = line(&format!("p {index:x} 123456 13880"));
        let mut bad = good.clone();
        let place = place.index(good.len() - 1);
        prop_assume!(bad[place] != wrong);
        bad[place] = wrong;
        // A line feed makes two damaged lines of one.
        let (messages, damaged) = read(&[b"\n".to_vec(), bad, good].concat());
        prop_assert_eq!(messages.len(), 1);
        prop_assert!(damaged >= 1 || place == 0 || wrong == b'\n');
    }

    #[test]
    fn arbitrary_bytes_are_survived(bytes in prop::collection::vec(any::<u8>(), 0..400)) {
        let _ = read(&bytes);
    }
}
