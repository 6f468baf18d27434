//! Several hosts, each with its recorder and its page over real connections: started, watched and stopped by one of them.

use std::{
    io::{Read, Write},
    net::TcpListener,
    path::Path,
    sync::Arc,
    thread,
    time::Duration,
};

use erfgs_recorder::{
    Level, Recorder,
    hosts::{HostEnd, HostError, HostLink, Hosts, StartError},
    live::LivePage,
};
use erfgs_session::Session;

use super::live::{get, page, post, rig, serve, wait_until};

/// The link of a page, as somebody on another host would write it.
fn link(page: &LivePage) -> HostLink {
    HostLink::parse(&page.url().replace("0.0.0.0", "127.0.0.1")).unwrap()
}

fn led_by(recorder: &Arc<Recorder>, links: Vec<HostLink>) -> Hosts {
    let hosts = Hosts::connect(links).unwrap();
    hosts.lead(recorder);
    hosts
}

/// Packets of a session, which must be whole.
fn packets(path: &Path) -> u64 {
    let session = Session::open(path).unwrap();
    assert!(session.summary().complete, "{}", path.display());
    session.summary().streams.iter().map(|stream| stream.totals.packets).sum()
}

fn has_message(recorder: &Recorder, level: Level, who: &str, what: &str) -> bool {
    let messages = recorder.messages();
    messages.iter().any(|message| message.level == level && message.stream.contains(who) && message.text.contains(what))
}

#[test]
fn all_hosts_record_before_the_one_that_leads_and_stop_with_it() {
    let folders = [(); 3].map(|()| tempfile::tempdir().unwrap());
    let (own, _) = rig(folders[0].path(), "left", 0);
    let (right, right_monitor) = rig(folders[1].path(), "right", 0);
    let right_page = page(&right, right_monitor, "0.0.0.0:0");
    // Two rigs may have one name.
    let (top, top_monitor) = rig(folders[2].path(), "right", 0);
    let top_page = page(&top, top_monitor, "127.0.0.1:0");
    let hosts = led_by(&own, vec![link(&right_page), link(&top_page)]);

    let path = folders[0].path().join("take1.mcap");
    hosts.start(&own, &path, Some(Duration::from_secs(1))).unwrap();
    assert!(own.is_recording() && right.is_recording() && top.is_recording());
    wait_until("packets of all", || {
        let views = hosts.views();
        let others = views.iter().map(|view| view.status().unwrap());
        others.chain([&*own.status()]).all(|status| status.streams.iter().all(|stream| stream.written > 3))
    });
    // Nobody is started twice.
    let again = hosts.start(&own, &folders[0].path().join("take2.mcap"), None).unwrap_err();
    assert!(matches!(again, StartError::Own(_)), "{again}");
    let summary = hosts.stop(&own, "enough").unwrap();
    assert!(!own.is_recording() && !right.is_recording() && !top.is_recording());

    let (session, takes) = hosts.last().unwrap();
    assert_eq!(session, summary.path);
    let names: Vec<_> = takes.iter().map(|take| take.path.file_name().unwrap().to_owned()).collect();
    assert_eq!(names, ["take1-right.mcap", "take1-right-2.mcap"]);
    for (take, folder) in takes.iter().zip(&folders[1..]) {
        let HostEnd::Stopped(summary) = &take.end else { panic!("{take:?}") };
        assert!(take.path.is_absolute() && take.path.parent() == Some(folder.path()), "{take:?}");
        assert_eq!(summary.streams.iter().map(|stream| stream.written).sum::<u64>(), packets(&take.path));
    }
    let command = format!("erfgs merge {} ", path.display());
    assert!(has_message(&own, Level::Info, "", &command), "{:?}", own.messages());

    // A second take; what ends the recording of the host that leads ends those of the others.
    hosts.start(&own, &folders[0].path().join("take2.mcap"), None).unwrap();
    own.stop_recording("Enter").unwrap();
    wait_until("the others have stopped", || !right.is_recording() && !top.is_recording());
    wait_until("the take is known", || hosts.last().is_some_and(|(session, _)| session.ends_with("take2.mcap")));
}

#[test]
fn hosts_that_cannot_record_are_named_with_what_to_do() {
    let folder = tempfile::tempdir().unwrap();
    let refused = |links: Vec<HostLink>| Hosts::connect(links).err().expect("it cannot record");
    let at = |port: u16, token: &str| HostLink::parse(&format!("http://127.0.0.1:{port}/?token={token}")).unwrap();
    let token = "0123456789abcdef0123456789abcdef";

    // Nobody listens.
    let nobody = { TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port() };
    let error = refused(vec![at(nobody, token)]);
    assert!(matches!(error, HostError::Unreachable { .. }), "{error}");
    assert!(error.to_string().contains(&nobody.to_string()) && error.to_string().contains("--live"), "{error}");

    // All that fail are named.
    let also = { TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port() };
    let error = refused(vec![at(nobody, token), at(also, token)]).to_string();
    assert!(error.contains(&nobody.to_string()) && error.contains(&also.to_string()), "{error}");

    // Another token, as of a recorder that was started again.
    let (recorder, served) = serve(folder.path(), "0.0.0.0:0");
    let error = refused(vec![at(served.address().port(), token)]);
    assert!(matches!(error, HostError::Token { .. }), "{error}");
    assert!(!format!("{error} {error:?}").contains(token), "{error}");
    let error = refused(vec![link(&served), link(&served)]);
    assert!(matches!(error, HostError::Twice { .. }), "{error}");

    // It records already.
    recorder.start_recording(&folder.path().join("own.mcap")).unwrap();
    wait_until("the status says so", || recorder.status().recording.is_some());
    let error = refused(vec![link(&served)]);
    assert!(matches!(error, HostError::Busy { .. }) && error.to_string().contains("own.mcap"), "{error}");
    recorder.stop_recording("enough").unwrap();

    // No room besides the reserve.
    let (full, monitor) = rig(folder.path(), "full", u64::MAX);
    let full_page = page(&full, monitor, "127.0.0.1:0");
    wait_until("the disk is looked at", || full.status().disk.total > 0);
    let error = refused(vec![link(&full_page)]);
    let here = folder.path().display().to_string();
    assert!(matches!(error, HostError::Disk { .. }) && error.to_string().contains(&here), "{error}");

    // Something else answers, or accepts and never does.
    let other = TcpListener::bind("127.0.0.1:0").unwrap();
    let port = other.local_addr().unwrap().port();
    thread::spawn(move || {
        for answer in [&b"HTTP/1.1 200 OK\r\ncontent-length: 2\r\n\r\n{}"[..], b"220 mail\r\n", b""] {
            let mut stream = other.accept().unwrap().0;
            let _ = stream.read(&mut [0; 1000]);
            if answer.is_empty() {
                thread::sleep(Duration::from_secs(5));
            }
            let _ = stream.write_all(answer);
        }
    });
    for _ in 0..2 {
        let error = refused(vec![at(port, token)]);
        assert!(matches!(error, HostError::Foreign { .. }), "{error}");
    }
    let error = refused(vec![at(port, token)]);
    assert!(matches!(error, HostError::Silent { .. }), "{error}");
}

#[test]
fn where_one_host_does_not_record_none_does() {
    let folders = [(); 2].map(|()| tempfile::tempdir().unwrap());
    let (own, _) = rig(folders[0].path(), "left", 0);
    let (right, right_page) = serve(folders[1].path(), "127.0.0.1:0");
    let (_top, top_page) = serve(folders[1].path(), "127.0.0.1:0");
    let hosts = led_by(&own, vec![link(&right_page), link(&top_page)]);
    // A session of the name that the second one would take.
    std::fs::write(folders[1].path().join("take-lab-2.mcap"), b"of somebody").unwrap();
    let path = folders[0].path().join("take.mcap");
    let error = hosts.start(&own, &path, None).unwrap_err();
    let StartError::Host { error: HostError::Refused { host, why }, stopped } = &error else { panic!("{error}") };
    assert!(*host == link(&top_page).name() && why.contains("exists already"), "{error}");
    assert_eq!(stopped.len(), 1, "{error}");
    assert!(stopped[0].ends_with("take-lab.mcap") && error.to_string().contains("take-lab.mcap"), "{error}");
    assert!(!own.is_recording() && !right.is_recording() && !path.exists());
    assert_eq!(std::fs::read(folders[1].path().join("take-lab-2.mcap")).unwrap(), b"of somebody");

    // Its disk would be full before the end.
    wait_until("data come", || hosts.views().iter().all(|view| view.status().unwrap().disk.seconds_left.is_some()));
    let error = hosts.start(&own, &path, Some(Duration::from_secs(1 << 40))).unwrap_err();
    let StartError::Host { error: HostError::Several(errors), stopped } = &error else { panic!("{error}") };
    assert!(errors.len() == 2 && errors.iter().all(|error| matches!(error, HostError::Disk { .. })), "{error}");
    assert!(stopped.is_empty() && !right.is_recording(), "{error}");

    // This host's own session is in the way.
    std::fs::remove_file(folders[1].path().join("take-lab-2.mcap")).unwrap();
    std::fs::remove_file(folders[1].path().join("take-lab.mcap")).unwrap();
    std::fs::write(&path, b"of somebody").unwrap();
    let error = hosts.start(&own, &path, None).unwrap_err();
    assert!(matches!(error, StartError::Own(_)), "{error}");
    assert!(!own.is_recording() && !right.is_recording());
}

#[test]
fn a_host_that_is_lost_costs_its_own_streams_and_is_stopped_when_it_is_back() {
    let folders = [(); 3].map(|()| tempfile::tempdir().unwrap());
    let (own, _) = rig(folders[0].path(), "left", 0);
    let (right, right_monitor) = rig(folders[1].path(), "right", 0);
    let right_page = page(&right, Arc::clone(&right_monitor), "127.0.0.1:0");
    let (top, top_monitor) = rig(folders[2].path(), "top", 0);
    let top_page = page(&top, top_monitor, "127.0.0.1:0");
    let (name, address) = (link(&right_page).name(), right_page.address().to_string());
    let hosts = led_by(&own, vec![link(&right_page), link(&top_page)]);
    hosts.start(&own, &folders[0].path().join("take.mcap"), None).unwrap();
    // Its network goes, and it records on.
    drop(right_page);
    wait_until("the loss is told", || has_message(&own, Level::Error, &name, "The others go on"));
    assert!(hosts.views()[0].lost.is_some() && hosts.views()[1].lost.is_none());
    assert!(own.is_recording() && top.is_recording() && right.is_recording());
    hosts.stop(&own, "enough").unwrap();
    let (_, takes) = hosts.last().unwrap();
    assert!(matches!(takes[0].end, HostEnd::Unknown { .. }), "{takes:?}");
    assert!(matches!(takes[1].end, HostEnd::Stopped { .. }), "{takes:?}");
    let (level, says) = takes[0].says();
    assert!(level == Level::Error && says.contains("take-right.mcap") && says.contains(&name), "{says}");
    packets(&takes[1].path);

    // When it is heard of again, what it should have been told is made up for.
    assert!(right.is_recording());
    let _right_page = page(&right, right_monitor, &address);
    wait_until("it is stopped", || !right.is_recording());
    wait_until("that is told", || has_message(&own, Level::Info, &name, "after the connection was restored"));
    packets(&takes[0].path);
}

#[test]
fn a_recording_that_ends_by_itself_on_another_host_is_told_at_once() {
    let folders = [(); 2].map(|()| tempfile::tempdir().unwrap());
    let (own, _) = rig(folders[0].path(), "left", 0);
    let (right, right_page) = serve(folders[1].path(), "127.0.0.1:0");
    let hosts = led_by(&own, vec![link(&right_page)]);
    hosts.start(&own, &folders[0].path().join("take.mcap"), None).unwrap();
    right.say(Level::Warning, "wheel", "hot");
    right.stop_recording("the disk is full").unwrap();
    let name = link(&right_page).name();
    wait_until("the end is told", || has_message(&own, Level::Error, &name, "the disk is full"));
    wait_until("its warning is told", || has_message(&own, Level::Warning, &format!("{name} wheel"), "hot"));
    assert!(own.is_recording());
    // What it does now is no business of the take.
    right.start_recording(&folders[1].path().join("of-somebody-else.mcap")).unwrap();
    hosts.stop(&own, "enough").unwrap();
    assert!(right.is_recording());
    let (_, takes) = hosts.last().unwrap();
    assert!(matches!(&takes[0].end, HostEnd::Early(summary) if summary.reason == "the disk is full"), "{takes:?}");
}

#[test]
fn one_page_shows_starts_and_stops_all() {
    let folders = [(); 2].map(|()| tempfile::tempdir().unwrap());
    let (own, own_page) = serve(folders[0].path(), "127.0.0.1:0");
    let (right, right_monitor) = rig(folders[1].path(), "right", 0);
    let right_page = page(&right, right_monitor, "0.0.0.0:0");
    let token = right_page.url().split_once("token=").unwrap().1.to_owned();
    let hosts = Arc::new(led_by(&own, vec![link(&right_page)]));
    let at = own_page.address();
    assert_eq!(get(at, "/api/status").json()["hosts"], serde_json::json!([]));
    assert_eq!(get(at, "/api/hosts/0/preview/wheel").code, 404);
    own_page.lead(hosts);

    for id in ["wheel", "frames"] {
        wait_until("a preview", || get(at, &format!("/api/hosts/0/preview/{id}?large=true")).code == 200);
        let answer = get(at, &format!("/api/hosts/0/preview/{id}"));
        assert!(answer.body.starts_with(&[0xff, 0xd8, 0xff]) && answer.head.contains("image/jpeg"), "{}", answer.head);
    }
    assert_eq!(get(at, "/api/hosts/0/knobs/wheel").code, 200);
    assert_eq!(post(at, "/api/hosts/0/span", "{\"us\": 2000}").json()["us"], 2000);
    // Nothing else of the other host can be reached through this one.
    for path in [
        "/api/hosts/1/preview/wheel",
        "/api/hosts/0/recordings",
        "/api/hosts/0/preview/..%2Fstatus",
        "/api/hosts/0/preview/a%20b",
        "/api/hosts/0/preview/wheel/x",
        "/api/hosts/x/preview/wheel",
    ] {
        assert!((400..405).contains(&get(at, path).code), "{path}");
    }
    assert_eq!(post(at, "/api/hosts/0/start", "{}").code, 404);
    assert!(!right.is_recording());

    assert_eq!(post(at, "/api/start", "{\"name\": \"take\"}").code, 200);
    assert!(own.is_recording() && right.is_recording());
    wait_until("the page says so", || {
        get(at, "/api/status").json()["hosts"][0]["status"]["recording"]["bytes"].as_u64() > Some(0)
    });
    assert_eq!(post(at, "/api/stop", "{}").code, 200);
    assert!(!own.is_recording() && !right.is_recording());
    packets(&folders[1].path().join("take-right.mcap"));

    drop(right_page);
    let refused = post(at, "/api/start", "{\"name\": \"other\"}");
    assert!(refused.code == 502 && refused.text().contains("cannot be reached"), "{}", refused.text());
    assert!(!own.is_recording());
    wait_until("the page says so", || get(at, "/api/status").json()["hosts"][0]["lost"].is_string());
    // The other host's secret is nowhere.
    assert!(!get(at, "/api/status").text().contains(&token));
    for folder in &folders {
        for entry in std::fs::read_dir(folder.path()).unwrap() {
            let bytes = std::fs::read(entry.unwrap().path()).unwrap();
            assert!(!bytes.windows(token.len()).any(|window| window == token.as_bytes()));
        }
    }
}
