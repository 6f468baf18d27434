//! What an EVK4 is set to: before it streams, while it does, and after it was away.

use std::sync::Arc;

use crate::usb_cameras::support::{
    Bucket,
    evk4::{decode, one, open, record, register},
};
use erfgs_events::{CdEvent, EventEncoding};
use erfgs_hardware_mocks::usb::Evk4Options;
use erfgs_rig::event::{
    Evk4Config, Evk4Source, Window,
    evk4::{AntiFlicker, BiasOffsets, MaskRows, RateLimit, Region, RegionMode, SyncRole, TrailFilter, TrailKind},
};
use erfgs_session::source::{Incident, Source};

#[test]
fn settings_are_written_and_read_back() {
    let (bus, camera) = one(Evk4Options::default(), Vec::new());
    let config = Evk4Config {
        biases: BiasOffsets { diff_on: 20, diff_off: -10, fo: -150, ..BiasOffsets::default() },
        region: Some(Region {
            mode: RegionMode::Keep,
            windows: vec![Window { x: 64, y: 32, width: 640, height: 480 }],
        }),
        mask_rows: MaskRows::FromBottom,
        masked_pixels: vec![[100, 40], [101, 41]],
        rate_limit: Some(RateLimit { events_per_second: 20_000_000, period_us: 200 }),
        anti_flicker: Some(AntiFlicker { low_hz: 90, high_hz: 110, ..AntiFlicker::default() }),
        trail_filter: Some(TrailFilter { kind: TrailKind::StcKeepTrail, threshold_ms: 10 }),
        sync: SyncRole::Master,
        ..Evk4Config::default()
    };
    let mut source = open(&bus, config).unwrap();
    // The unit's trim of diff_on is 0x66 + 3, of diff_off 0x49 - 4, of fo 0x53 - 2, which stops at 0.
    assert_eq!(register(&camera, 0x1010), 0x11A1_0000 | (0x69 + 20));
    assert_eq!(register(&camera, 0x1018), 0x11A1_0000 | (0x45 - 10));
    assert_eq!(register(&camera, 0x1004), 0x11A1_0000);
    assert_eq!(register(&camera, 0x9008), 0x64E);
    assert_eq!(register(&camera, 0x0044), 0xCCFC_FCCF);
    assert_eq!(register(&camera, 0x7004) >> 10 & 1, 1);
    assert_eq!([register(&camera, 0x6008), register(&camera, 0x600C), register(&camera, 0x6050)], [200, 4000, 1]);
    assert_eq!(register(&camera, 0x6400 + 4 * 255), 511 << 16 | 510);
    assert_eq!(register(&camera, 0x6800 + 4 * 229), 0x0808_0808);
    assert_eq!([register(&camera, 0xC000), register(&camera, 0xD000)], [1, 1]);
    // 11,111 µs and 9091 µs in units of 128 µs.
    assert_eq!(register(&camera, 0xC008) & 0xFFFF, 86 << 8 | 71);
    assert_eq!(register(&camera, 0xD004), 1 | 10_000 << 1 | 1 << 24);
    assert_eq!(register(&camera, 0xD00C), 13 | 9 << 5 | 1 << 16);
    assert_eq!(register(&camera, 0x9104), 101 | (719 - 41) << 16 | 1 << 31);
    let settings = &source.description().settings;
    assert_eq!(settings["biases"]["diff_on"]["trim"], 0x69);
    assert_eq!(settings["biases"]["diff_on"]["value"], 0x69 + 20);
    assert_eq!(settings["firmware"], "3.9.0");
    assert_eq!(settings["rate_limit"]["events_per_second"], 20_000_000);
    assert_eq!(settings["external_trigger"], true);
    // The trim of fo is 81: an offset of -150 stops at 0.
    assert_eq!(settings["not_applied"], serde_json::json!(["biases.fo = -150 (it has -81)"]));
    assert_eq!(source.description().serial, "00051234");
    assert!(source.description().start_order > 0);
    // The sensor keeps the window and silences the pixel inside of it.
    let bucket = record(&mut source, 20_000);
    for event in decode(&bucket, EventEncoding::Evt3).iter().flat_map(|run| &run.events) {
        assert!((64..704).contains(&event.x) && (32..512).contains(&event.y), "{event:?}");
        assert!((event.x, event.y) != (100, 40));
    }
}

#[test]
fn settings_are_changed_while_it_sends() {
    let (bus, camera) = one(Evk4Options::default(), Vec::new());
    let mut source = open(&bus, Evk4Config::default()).unwrap();
    let bucket = Arc::new(Bucket::default());
    source.start(bucket.clone()).unwrap();
    bucket.wait_for_bytes(100_000);
    let trimmed = register(&camera, 0x1010) & 0xFF;
    let adjust = |source: &mut Evk4Source, changed: serde_json::Value| {
        source.adjust(changed.as_object().unwrap()).map_err(|error| error.to_string())
    };
    let window = serde_json::json!([{ "x": 300, "y": 200, "width": 400, "height": 300 }]);
    let changed = serde_json::json!({
        "biases": { "diff_on": 20 },
        "region": { "windows": window },
        "rate_limit": { "events_per_second": 5_000_000 },
    });
    adjust(&mut source, changed).unwrap();
    assert_eq!(register(&camera, 0x1010) & 0xFF, trimmed + 20);
    assert_eq!(register(&camera, 0x600C) & 0x3F_FFFF, 1000, "5 Mev/s are 1000 within 200 us");
    let settings = &source.description().settings;
    assert_eq!(settings["biases"]["diff_on"]["offset"], 20);
    assert_eq!(settings["region"]["windows"], window);
    assert!(settings["stream"]["transfers"].is_number(), "what the start noted stays");
    // What was in flight passes; then every event lies within the window.
    bucket.wait_for_bytes(1_000_000);
    let from = bucket.packets.lock().unwrap().len();
    bucket.wait_for_bytes(100_000);
    source.stop().unwrap();
    let late: Vec<_> = bucket.packets.lock().unwrap().drain(..).skip(from).collect();
    *bucket.packets.lock().unwrap() = late;
    let runs = decode(&bucket, EventEncoding::Evt3);
    let inside = |event: &CdEvent| (300..700).contains(&event.x) && (200..500).contains(&event.y);
    // The first words may belong to a row that was named before.
    let outside: Vec<_> = runs[0].events.iter().skip(100).filter(|event| !inside(event)).collect();
    assert!(runs[0].events.len() > 500, "{} events", runs[0].events.len());
    assert!(outside.is_empty(), "{} of {}: {:?}", outside.len(), runs[0].events.len(), outside[0]);
    let knobs = source.knobs();
    let value = |path: &str| knobs.iter().find(|knob| knob.path == path).unwrap().value.clone();
    assert_eq!((value("biases.diff_on"), value("rate_limit.events_per_second")), (20.into(), 5_000_000.into()));
    assert_eq!(value("region.windows")["width"], 400);

    let filters = serde_json::json!({
        "anti_flicker": { "low_hz": 90, "high_hz": 110 },
        "trail_filter": { "kind": "stc-cut-trail", "threshold_ms": 10 },
    });
    adjust(&mut source, filters).unwrap();
    assert_eq!(source.description().settings["trail_filter"]["threshold_ms"], 10);
    // Back to what the unit was trimmed to, and off.
    adjust(&mut source, serde_json::json!({ "biases": { "diff_on": 0 }, "rate_limit": null, "region": null })).unwrap();
    assert_eq!(register(&camera, 0x1010) & 0xFF, trimmed);
    assert!(source.knobs().iter().any(|knob| knob.path == "rate_limit.events_per_second" && knob.value.is_null()));
    // What is refused changes nothing.
    for (wrong, says) in [
        (serde_json::json!({ "biases": { "diff_on": 9999 } }), "biases.diff_on"),
        (serde_json::json!({ "biases": { "diff_onn": 1 } }), "diff_onn"),
        (serde_json::json!({ "format": "evt21" }), "while the camera runs"),
        (serde_json::json!({ "trail_filter": { "kind": "none" } }), "none"),
    ] {
        let error = adjust(&mut source, wrong).unwrap_err();
        assert!(error.contains(says), "{error}");
    }
    assert_eq!(register(&camera, 0x1010) & 0xFF, trimmed);
}

#[test]
fn a_camera_that_comes_back_has_the_settings_that_were_changed() {
    let (bus, camera) = one(Evk4Options::default(), Vec::new());
    let mut source = open(&bus, Evk4Config::default()).unwrap();
    let trimmed = register(&camera, 0x1018) & 0xFF;
    let bucket = Arc::new(Bucket::default());
    source.start(bucket.clone()).unwrap();
    bucket.wait_for_bytes(10_000);
    source.adjust(serde_json::json!({ "biases": { "diff_off": -7 } }).as_object().unwrap()).unwrap();
    camera.lock().unwrap().unplug();
    bucket.wait_until("the loss", |bucket| !bucket.incidents().is_empty());
    camera.lock().unwrap().plug();
    bucket.wait_until("the return", |bucket| bucket.incidents().contains(&Incident::Back));
    assert_eq!(register(&camera, 0x1018) & 0xFF, trimmed - 7);
    source.stop().unwrap();
}
