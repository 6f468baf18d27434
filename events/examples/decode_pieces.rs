//! Decodes the EVT 3 words of a Prophesee sensor as they arrive on the standard input, in pieces of any size, and prints the
//! event rate of every tenth of a second of the sensor's clock.
//!
//! usage: decode_pieces < WORDS

use std::{
    error::Error,
    io::{self, Read},
};

use erfgs_events::{CdEvent, Decoder, Evt3Decoder, SensorSize, Sink};

const BIN_US: u64 = 100_000;

/// The bin of time that is being filled.
#[derive(Default)]
struct Rate {
    bin: u64,
    events: u64,
}

impl Sink for Rate {
    fn event(&mut self, event: CdEvent) {
        let bin = event.t_us / BIN_US;
        if bin != self.bin {
            self.print();
            *self = Self { bin, events: 0 };
        }
        self.events += 1;
    }

    fn discontinuity(&mut self, t_us: u64) {
        println!("data were lost before {t_us} us");
    }
}

impl Rate {
    fn print(&self) {
        if self.events > 0 {
            println!(
                "{:.1} s: {} events a second",
                (self.bin * BIN_US) as f64 * 1e-6,
                self.events * 1_000_000 / BIN_US
            );
        }
    }
}

fn main() -> Result<(), Box<dyn Error>> {
    let mut decoder = Evt3Decoder::new(Some(SensorSize { width: 1280, height: 720 }));
    let mut rate = Rate::default();
    let mut piece = vec![0; 1 << 16];
    loop {
        let bytes = io::stdin().read(&mut piece)?;
        if bytes == 0 {
            break;
        }
        decoder.decode(&piece[..bytes], &mut rate);
    }
    decoder.finish(&mut rate);
    rate.print();
    println!("anomalies: {}", decoder.anomalies());
    Ok(())
}
