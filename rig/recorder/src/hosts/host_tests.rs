use std::{
    io::{Read, Write},
    net::TcpListener,
    sync::Arc,
};

use super::*;

/// A host that says that it records `take.mcap`, and refuses to stop.
fn stubborn() -> HostLink {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let link = HostLink::parse(&format!("http://{}/", listener.local_addr().unwrap())).unwrap();
    let report =
        HostReport { status: Status::default(), looks: Vec::new(), guidance: Vec::new(), folder: "there".into() };
    let mut report = serde_json::to_value(report).unwrap();
    report["status"]["recording"] = serde_json::json!({ "path": "there/take.mcap", "seconds": 2.5, "bytes": 1000, "bytes_per_s": 0.0, "slowest_write_ms": 0.0 });
    std::thread::spawn(move || {
        for stream in listener.incoming() {
            let mut stream = stream.unwrap();
            let mut request = [0; 2000];
            let length = stream.read(&mut request).unwrap_or(0);
            let is_order = request[..length].starts_with(b"POST");
            let (code, body) = if is_order { ("409 Conflict", "{}".into()) } else { ("200 OK", report.to_string()) };
            let head = format!("HTTP/1.1 {code}\r\ncontent-length: {}\r\nconnection: close\r\n\r\n", body.len());
            let _ = stream.write_all((head + &body).as_bytes());
        }
    });
    link
}

fn take() -> Take {
    Take { name: "take.mcap".into(), path: "there/take.mcap".into(), seconds: 0.0, bytes: 0, end: None, over: false }
}

#[test]
fn a_host_that_records_on_keeps_nobody_waiting() {
    let host = Arc::new(Host::new(stubborn()));
    host.state().take = Some(take());
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
    let end = runtime.block_on(host.end_recording("take.mcap", GIVE_UP, Duration::from_millis(1)));
    let HostEnd::Unknown { why, seconds, bytes } = &end else { panic!("{end:?}") };
    assert!(why.contains("still records"), "{why}");
    assert_eq!((*seconds, *bytes), (2.5, 1000));
    // The user is told where to stop it.
    host.state().take = Some(Take { end: Some(end), ..take() });
    let (level, says) = host.host_take(host.state().take.as_ref().unwrap()).unwrap().says();
    assert!(level == Level::Error && says.contains("stop it on its page"), "{says}");
}

#[test]
fn a_host_that_says_much_is_told_of_in_few_words() {
    let errors = |count: usize| vec![(Level::Error, String::new(), "hot".to_owned()); count];
    let (mut telling, begun) = (None, Instant::now());
    assert_eq!(few(&mut telling, errors(3), begun).len(), 3);
    let more: usize = (0..100).map(|_| few(&mut telling, errors(10), begun + WHILE / 2).len()).sum();
    assert_eq!(more, MOST_MESSAGES - 3);
    let later = few(&mut telling, errors(1), begun + WHILE);
    assert_eq!(later[0].2, format!("{} more messages are shown on its page", 1000 + 3 - MOST_MESSAGES));
    assert_eq!(later.len(), 2);
    assert_eq!(few(&mut telling, Vec::new(), begun + 2 * WHILE), []);
}
