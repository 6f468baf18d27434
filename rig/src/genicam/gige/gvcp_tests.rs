use proptest::prelude::*;

use super::*;

const MS: i64 = 1_000_000;

#[test]
fn commands_are_the_bytes_of_the_protocol() {
    let bytes = |command: Command<'_>| command.datagram(0x1234);
    assert_eq!(bytes(Command::Discover), [0x42, 0x11, 0, 2, 0, 0, 0x12, 0x34]);
    assert_eq!(bytes(Command::ReadRegister(0xa00)), [0x42, 1, 0, 0x80, 0, 4, 0x12, 0x34, 0, 0, 0x0a, 0]);
    assert_eq!(
        bytes(Command::WriteRegister(0xa00, 2)),
        [0x42, 1, 0, 0x82, 0, 8, 0x12, 0x34, 0, 0, 0x0a, 0, 0, 0, 0, 2]
    );
    assert_eq!(bytes(Command::ReadMemory(0x200, 512)), [0x42, 1, 0, 0x84, 0, 8, 0x12, 0x34, 0, 0, 2, 0, 0, 0, 2, 0]);
    assert_eq!(
        bytes(Command::WriteMemory(0xe8, b"left")),
        [0x42, 1, 0, 0x86, 0, 8, 0x12, 0x34, 0, 0, 0, 0xe8, b'l', b'e', b'f', b't']
    );
    assert_eq!(
        ask_again(7, 0x0102, [3, 0x0a_0b0c], false),
        [0x42, 0, 0, 0x40, 0, 12, 0, 7, 0, 0, 1, 2, 0, 0, 0, 3, 0, 0x0a, 0x0b, 0x0c]
    );
    assert_eq!(
        ask_again(7, 0x0102, [3, 4], true),
        [0x42, 0x10, 0, 0x40, 0, 20, 0, 7, 0, 0, 0, 0, 0, 0, 0, 3, 0, 0, 0, 4, 0, 0, 0, 0, 0, 0, 1, 2]
    );
}

#[test]
fn a_command_is_repeated_with_its_id_until_the_camera_answers_it() {
    let mut exchange = Exchange::new(Command::ReadRegister(0xa00), 9, 2, 500 * MS);
    assert_eq!(exchange.step(0), Step::Send);
    assert_eq!(exchange.step(100 * MS), Step::WaitUntil(500 * MS));
    // Another command's answer, a request, an answer without its value.
    for other in
        [&[0, 0, 0, 0x81, 0, 4, 0, 8, 1, 2, 3, 4][..], &[0x42, 1, 0, 0x80, 0, 0, 0, 9], &[0, 0, 0, 0x81, 0, 0, 0, 9]]
    {
        assert_eq!(exchange.take(other, 0), None);
    }
    assert_eq!(exchange.step(500 * MS), Step::Send);
    assert_eq!(exchange.take(&[0, 0, 0, 0x81, 0, 4, 0, 9, 1, 2, 3, 4], 600 * MS), Some(Ok(vec![1, 2, 3, 4])));
    assert_eq!(exchange.step(1000 * MS), Step::Silent);
    let refused = exchange.take(&[0x80, 6, 0, 0x81, 0, 0, 0, 9], 0).unwrap().unwrap_err();
    assert_eq!((refused, refused.to_string()), (Status::ACCESS_DENIED, "access denied (status 0x8006)".into()));
}

#[test]
fn a_camera_may_put_its_answer_off_but_not_for_ever() {
    let mut exchange = Exchange::new(Command::WriteRegister(0, 1), 9, 1, 500 * MS);
    assert_eq!(exchange.step(0), Step::Send);
    let later = [0, 0, 0, 0x89, 0, 4, 0, 9, 0, 0, 0x13, 0x88];
    assert_eq!(exchange.take(&later, 100 * MS), None);
    assert_eq!(exchange.step(4000 * MS), Step::WaitUntil(5100 * MS));
    for _ in 0..10 {
        assert_eq!(exchange.take(&later, 5000 * MS), None);
    }
    assert_eq!(exchange.step(5000 * MS), Step::Silent);
}

#[test]
fn an_identity_is_read_from_the_registers() {
    let mut data = vec![0; 0xf8];
    data[0x0a..0x10].copy_from_slice(&[0, 1, 2, 0xab, 4, 5]);
    data[0x24..0x28].copy_from_slice(&[192, 168, 1, 7]);
    data[0x34..0x38].copy_from_slice(&[255, 255, 255, 0]);
    data[0x48..0x4d].copy_from_slice(b"Maker");
    data[0x68..0x6f].copy_from_slice(b"Mono\x1b1\n");
    data[0xd8..0xe8].copy_from_slice(b"0123456789abcdef");
    let answer = [&[0, 0, 0, 3, 0, 0xf8, 0, 1][..], &data].concat();
    let found = Identity::of_answer(&answer, 1).unwrap();
    assert_eq!((found.address, found.mask), ([192, 168, 1, 7].into(), [255, 255, 255, 0].into()));
    assert_eq!((found.mac_text(), found.label()), ("00:01:02:ab:04:05".into(), "Maker Mono?1".into()));
    assert_eq!((found.serial.as_str(), found.name.as_str()), ("0123456789abcdef", ""));
    assert_eq!(Identity::of_answer(&answer, 2), None);
    assert_eq!(Identity::of_answer(&answer[..40], 1), None);
}

proptest! {
    #[test]
    fn no_datagram_makes_it_panic_or_answer_for_another(bytes in prop::collection::vec(any::<u8>(), 0..64), id in 1_u16.., now_ns: i64) {
        let mut exchange = Exchange::new(Command::ReadRegister(0), id, 3, MS);
        let _ = exchange.step(now_ns);
        if let Some(answer) = exchange.take(&bytes, now_ns) {
            prop_assert_eq!(&bytes[6..8], id.to_be_bytes());
            prop_assert!(answer.is_err() || answer.unwrap().len() == 4);
        }
        let _ = exchange.step(now_ns);
        let _ = Identity::of_answer(&bytes, id);
        let _ = Identity::of_registers(&bytes);
    }
}
