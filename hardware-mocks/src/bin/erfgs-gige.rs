//! `erfgs-gige`: an emulated GigE Vision camera for programs of others, until it is told to stop.

use std::{error::Error, net::Ipv4Addr};

use clap::Parser;
use erfgs_hardware_mocks::{
    gige::{GigeFront, GigeOptions},
    usb::scene::PatternFrames,
};

/// Serves an emulated GigE Vision camera until its input ends.
#[derive(Parser)]
#[command(version)]
struct Cli {
    /// The address of this machine that the camera is to have.
    #[arg(long, default_value = "127.0.0.1")]
    address: Ipv4Addr,
    /// The broadcast that it is to hear, too.
    #[arg(long, default_value = "255.255.255.255")]
    broadcast: Ipv4Addr,
    /// Serial number.
    #[arg(long, default_value = "GEV00001")]
    serial: String,
}

fn main() -> Result<(), Box<dyn Error>> {
    let cli = Cli::parse();
    let options = GigeOptions { serial: cli.serial, ..GigeOptions::default() };
    let front = GigeFront::plug_at(options, Box::new(PatternFrames::new()), cli.address, cli.broadcast)?;
    std::io::copy(&mut std::io::stdin(), &mut std::io::sink())?;
    println!("{:?}", front.camera().counts());
    Ok(())
}
