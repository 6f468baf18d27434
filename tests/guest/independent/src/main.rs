//! An independent check of the emulated cameras: the published crate `neuromorphic-drivers` opens them and decodes what
//! they send, and every event, inertial sample and frame is compared with what the models are known to send.
//!
//! usage: independent evk4 SERIAL RATE_HZ SECONDS | independent davis346 SERIAL RATE_HZ SECONDS
//! SECONDS are those of the camera's clock: however slowly this machine runs, that much data is compared.

use std::{
    process::ExitCode,
    time::{Duration, Instant},
};

use neuromorphic_drivers::{self as nd, GenericDevice as _, types::Polarity, types::TriggerPolarity};

/// Event `k` of the pattern (hardware-mocks/src/usb/scene/pattern.rs): time, column, row, ON.
fn pattern(k: u64, rate_hz: u64, width: u64, height: u64) -> (u64, u16, u16, bool) {
    (k * 1_000_000 / rate_hz, (k % width) as u16, (k / width % height) as u16, k & 32 != 0)
}

/// Follows the pattern, event by event.
struct Follower {
    rate_hz: u64,
    width: u64,
    height: u64,
    next: Option<u64>,
    first_us: Option<u64>,
    last_us: u64,
    events: u64,
    wrong: Vec<String>,
}

impl Follower {
    fn new(rate_hz: u64, width: u64, height: u64) -> Self {
        Self { rate_hz, width, height, next: None, first_us: None, last_us: 0, events: 0, wrong: Vec::new() }
    }

    fn event(&mut self, t: u64, x: u16, y: u16, on: bool) {
        let k = self.next.unwrap_or_else(|| {
            let first = (t * self.rate_hz).div_ceil(1_000_000);
            (first..first + self.rate_hz / 1_000_000 + 2)
                .find(|&k| pattern(k, self.rate_hz, self.width, self.height) == (t, x, y, on))
                .unwrap_or(first)
        });
        let expected = pattern(k, self.rate_hz, self.width, self.height);
        if expected != (t, x, y, on) && self.wrong.len() < 10 {
            self.wrong.push(format!("event {k} is {:?} and should be {expected:?}", (t, x, y, on)));
        }
        self.next = Some(k + 1);
        self.first_us.get_or_insert(t);
        self.last_us = t;
        self.events += 1;
    }

    /// Seconds of the camera's clock from the first event to the last.
    fn seconds(&self) -> f64 {
        self.first_us.map_or(0.0, |first| self.last_us.saturating_sub(first) as f64 * 1e-6)
    }

    /// Whether enough events came, and all as they should.
    fn report(self, name: &str, seconds: f64) -> bool {
        println!("{name}: {} events over {:.2} s, {} wrong", self.events, self.seconds(), self.wrong.len());
        for wrong in &self.wrong {
            println!("{name}: {wrong}");
        }
        self.wrong.is_empty() && self.seconds() >= seconds
    }
}

/// The longest that this machine may take for it.
const PATIENCE: Duration = Duration::from_secs(90);

/// One transfer in flight. With several, the crate's ring takes transfers for complete in the order of its buffers, and
/// a buffer that is filled and submitted again before all have been submitted at the start breaks that order.
fn ring(default: nd::RingConfiguration) -> nd::RingConfiguration {
    nd::RingConfiguration { parallel_submissions: 1, ..default }
}

fn evk4(serial: &str, rate_hz: u64, seconds: f64) -> Result<bool, Box<dyn std::error::Error>> {
    let (flag, event_loop) = nd::flag_and_event_loop()?;
    let opening = Instant::now();
    let device = nd::prophesee_evk4::open(
        nd::Identifier::Serial(serial),
        nd::prophesee_evk4::DEFAULT_CONFIGURATION,
        &ring(nd::prophesee_evk4::RING_CONFIGURATION),
        event_loop,
        flag.clone(),
    )?;
    println!(
        "evk4: opened {} after {:.1} s, {:?}",
        device.serial(),
        opening.elapsed().as_secs_f64(),
        device.biases_bounds()
    );
    println!("evk4: temperature {:?}", device.temperature_celsius()?);
    let mut adapter = device.create_adapter();
    let mut follower = Follower::new(rate_hz, 1280, 720);
    let mut edges: Vec<(u64, bool)> = Vec::new();
    let end = Instant::now() + PATIENCE;
    while follower.seconds() < seconds && Instant::now() < end {
        flag.load_error()?;
        if let Some(view) = device.next_with_timeout(&Duration::from_millis(100)) {
            adapter.convert(
                view.slice,
                |event| follower.event(event.t, event.x, event.y, event.polarity == Polarity::On),
                |edge| edges.push((edge.t, edge.polarity == TriggerPolarity::Rising)),
            );
        }
    }
    let dropped = device.dropped_packets();
    println!("evk4: {} edges, {dropped} packets dropped", edges.len());
    // The line carries pulses of 5 ms each 20 ms.
    let sound = edges.windows(2).all(|pair| {
        let gap = pair[1].0 - pair[0].0;
        pair[0].1 != pair[1].1 && gap.abs_diff(if pair[0].1 { 5_000 } else { 15_000 }) <= 1
    });
    if !sound {
        println!("evk4: the edges are not those of the line: {:?}", &edges[..edges.len().min(10)]);
    }
    let enough = edges.len() as f64 >= 100.0 * seconds - 2.0;
    Ok(follower.report("evk4", seconds) && sound && enough && dropped == 0)
}

fn davis346(serial: &str, rate_hz: u64, seconds: f64) -> Result<bool, Box<dyn std::error::Error>> {
    let (flag, event_loop) = nd::flag_and_event_loop()?;
    let configuration = nd::inivation_davis346::Configuration {
        frame_interval_us: 200_000,
        ..nd::inivation_davis346::DEFAULT_CONFIGURATION
    };
    let device = nd::inivation_davis346::open(
        nd::Identifier::Serial(serial),
        configuration,
        &ring(nd::inivation_davis346::RING_CONFIGURATION),
        event_loop,
        flag.clone(),
    )?;
    println!("davis346: opened {}", device.serial());
    let mut adapter = device.create_adapter();
    let mut follower = Follower::new(rate_hz, 346, 260);
    let (mut samples, mut frames) = (Vec::new(), Vec::new());
    let end = Instant::now() + PATIENCE;
    while follower.seconds() < seconds && Instant::now() < end {
        flag.load_error()?;
        if let Some(view) = device.next_with_timeout(&Duration::from_millis(100)) {
            adapter.convert(
                view.slice,
                |event| follower.event(event.t, event.x, event.y, event.polarity == Polarity::On),
                |sample| samples.push((sample.t, sample.accelerometer_z)),
                |_| {},
                |frame| {
                    let levels: Vec<u16> = frame.pixels.to_vec();
                    frames.push((frame.exposure_start_t, frame.exposure_end_t, levels));
                },
            );
        }
    }
    println!(
        "davis346: {} inertial samples, {} frames, {} packets dropped",
        samples.len(),
        frames.len(),
        device.dropped_packets()
    );
    let mut sound = device.dropped_packets() == 0;
    // A sample each millisecond, with one standard gravity along z.
    sound &= samples.len() as f64 > 0.9 * 1000.0 * seconds;
    sound &= samples.windows(2).all(|pair| pair[1].0 - pair[0].0 == 1000);
    sound &= samples.iter().all(|sample| (sample.1 - 9.80665).abs() < 0.01);
    // Frames each 200 ms, exposed for 4 ms, of the chart of 16 pictures (10-bit levels, shifted up by 6 in the crate).
    sound &= frames.len() as f64 >= 5.0 * seconds - 2.0;
    sound &=
        frames.windows(2).all(|pair| pair[0].0.zip(pair[1].0).is_some_and(|(first, second)| second - first == 200_000));
    for (index, (start, end, levels)) in frames.iter().enumerate() {
        let exposed = end.zip(*start).map(|(end, start)| end - start);
        let expected: Vec<u16> = chart(index as u64 % 16).into_iter().map(|luma| u16::from(luma) * 2 << 6).collect();
        if exposed != Some(4000) || *levels != expected {
            println!("davis346: frame {index} is exposed for {exposed:?} us, or its picture differs");
            sound = false;
        }
    }
    Ok(follower.report("davis346", seconds) && sound)
}

/// Luma of picture `key` of the chart (hardware-mocks/src/usb/scene/pattern.rs), 346 x 260.
fn chart(key: u64) -> Vec<u8> {
    let (width, height) = (346, 260);
    let shift = key as u32 * width / 16;
    (0..height)
        .flat_map(|y| {
            (0..width).map(move |x| {
                let u = (x + shift) % width;
                let tile = (u / 16 + y / 16) % 2 * 48;
                ((u * 200 / width + tile) * 77 + (y * 200 / height + tile) * 150 + 64 * 29 + 128 >> 8) as u8
            })
        })
        .collect()
}

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let outcome = match &arguments[..] {
        [kind, serial, rate, seconds] => match (kind.as_str(), rate.parse(), seconds.parse()) {
            ("evk4", Ok(rate), Ok(seconds)) => evk4(serial, rate, seconds),
            ("davis346", Ok(rate), Ok(seconds)) => davis346(serial, rate, seconds),
            _ => Err("usage: independent evk4|davis346 SERIAL RATE_HZ SECONDS".into()),
        },
        _ => Err("usage: independent evk4|davis346 SERIAL RATE_HZ SECONDS".into()),
    };
    match outcome {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::FAILURE,
        Err(error) => {
            eprintln!("independent: {error}");
            ExitCode::FAILURE
        }
    }
}
