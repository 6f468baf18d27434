//! The camera behind sockets of this machine.

use std::{
    io,
    net::{Ipv4Addr, SocketAddr, SocketAddrV4, UdpSocket},
    sync::{
        Arc, Mutex, MutexGuard, PoisonError,
        atomic::{AtomicBool, AtomicU32, Ordering},
    },
    thread::{self, JoinHandle},
    time::Duration,
};

use super::{GigeCamera, GigeOptions};
use crate::usb::scene::FrameScene;

const PORT: u16 = 3956;
/// How often the camera is asked what it has to send.
const TURN: Duration = Duration::from_millis(1);
/// How many addresses are tried.
const TRIES: u32 = 1000;

/// True time: `CLOCK_MONOTONIC`, nanoseconds.
#[must_use]
pub fn now_ns() -> i64 {
    let now = rustix::time::clock_gettime(rustix::time::ClockId::Monotonic);
    now.tv_sec * 1_000_000_000 + now.tv_nsec
}

/// A camera that is plugged in, until this is dropped.
pub struct GigeFront {
    camera: Arc<Mutex<GigeCamera>>,
    address: Ipv4Addr,
    ending: Arc<AtomicBool>,
    threads: Vec<JoinHandle<()>>,
}

impl GigeFront {
    /// Plugs a camera in at a loopback address that nobody else has.
    ///
    /// # Errors
    /// If the system gives no sockets.
    pub fn plug(options: GigeOptions, scene: Box<dyn FrameScene>) -> io::Result<Self> {
        static NEXT: AtomicU32 = AtomicU32::new(0);
        for _ in 0..TRIES {
            let number = NEXT.fetch_add(1, Ordering::Relaxed);
            let process = std::process::id();
            let address =
                Ipv4Addr::new(127, 1 + (process % 250) as u8, (process / 250 % 250) as u8, 1 + (number % 250) as u8);
            match UdpSocket::bind((address, PORT)) {
                Ok(socket) => return Self::behind(options, scene, address, vec![socket]),
                Err(error) if error.kind() == io::ErrorKind::AddrInUse => {}
                Err(error) => return Err(error),
            }
        }
        Err(io::ErrorKind::AddrInUse.into())
    }

    /// Plugs a camera in at an address of this machine; it hears broadcasts to `broadcast`, too.
    ///
    /// # Errors
    /// If there is another already.
    pub fn plug_at(
        options: GigeOptions,
        scene: Box<dyn FrameScene>,
        address: Ipv4Addr,
        broadcast: Ipv4Addr,
    ) -> io::Result<Self> {
        let sockets = [address, broadcast].map(|at| UdpSocket::bind((at, PORT)));
        Self::behind(options, scene, address, sockets.into_iter().collect::<io::Result<_>>()?)
    }

    fn behind(
        options: GigeOptions,
        scene: Box<dyn FrameScene>,
        address: Ipv4Addr,
        control: Vec<UdpSocket>,
    ) -> io::Result<Self> {
        let mut camera = GigeCamera::new(options, address, scene);
        let stream = UdpSocket::bind((address, 0))?;
        camera.set_stream_source(stream.local_addr()?.port());
        let camera = Arc::new(Mutex::new(camera));
        let ending = Arc::new(AtomicBool::new(false));
        let answers = control.first().map(UdpSocket::try_clone).transpose()?;
        let mut threads = Vec::new();
        for socket in control {
            socket.set_read_timeout(Some(Duration::from_millis(50)))?;
            // What hears a broadcast answers from the camera's own address.
            let from = answers.as_ref().map(UdpSocket::try_clone).transpose()?;
            let (camera, ending) = (Arc::clone(&camera), Arc::clone(&ending));
            threads.push(thread::Builder::new().name("gige control".into()).spawn(move || {
                while !ending.load(Ordering::Relaxed) {
                    listen(&socket, from.as_ref().unwrap_or(&socket), &camera);
                }
            })?);
        }
        let (sender, stopping) = (Arc::clone(&camera), Arc::clone(&ending));
        threads.push(thread::Builder::new().name("gige stream".into()).spawn(move || {
            while !stopping.load(Ordering::Relaxed) {
                send(&stream, &sender);
                thread::sleep(TURN);
            }
        })?);
        Ok(Self { camera, address, ending, threads })
    }

    /// Where it is.
    #[must_use]
    pub fn address(&self) -> Ipv4Addr {
        self.address
    }

    /// The camera.
    pub fn camera(&self) -> MutexGuard<'_, GigeCamera> {
        lock(&self.camera)
    }
}

fn lock(camera: &Mutex<GigeCamera>) -> MutexGuard<'_, GigeCamera> {
    camera.lock().unwrap_or_else(PoisonError::into_inner)
}

fn listen(socket: &UdpSocket, from: &UdpSocket, camera: &Mutex<GigeCamera>) {
    let mut buffer = [0; 2048];
    let Ok((count, SocketAddr::V4(host))) = socket.recv_from(&mut buffer) else { return };
    let answer = lock(camera).command(&buffer[..count], host, now_ns());
    if let Some(answer) = answer {
        // A host that is gone hears nothing.
        let _ = from.send_to(&answer, SocketAddrV4::new(*host.ip(), host.port()));
    }
}

fn send(stream: &UdpSocket, camera: &Mutex<GigeCamera>) {
    lock(camera).advance(now_ns());
    // One at a time, so that commands come in between.
    while let Some((to, bytes)) = { lock(camera).outgoing() } {
        let _ = stream.send_to(&bytes, to);
    }
}

impl Drop for GigeFront {
    fn drop(&mut self) {
        self.ending.store(true, Ordering::Relaxed);
        for thread in self.threads.drain(..) {
            // A panic of the model was told when it happened.
            let _ = thread.join();
        }
    }
}
