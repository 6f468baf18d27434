//! Asynchronous bulk transfers through libusb: the only place of the drivers that needs `unsafe`.
//!
//! libusb keeps raw pointers to transfers, their buffers and their user data between submission and the callback. What
//! makes that sound:
//!
//! 1. **Ownership.** [`Flown`] owns every transfer and its buffer, and a reference to [`Shared`]. It is given to the
//!    event thread, which drops it only when `in_flight` is zero, that is when libusb holds no pointer of ours.
//! 2. **Count.** `in_flight` counts transfers that libusb may touch. It rises before a submission and falls when the
//!    submission fails or as the last thing the callback does with a transfer that it does not submit again.
//! 3. **Lifetime of the device.** `Flown` also holds the opened device, so that the device is closed after the last
//!    callback. If transfers do not come back within [`PATIENCE`] after they were cancelled, all of it is leaked: memory
//!    that the kernel may still write to is never freed.
//! 4. **Threads.** libusb calls back from whichever thread handles its events: ours, or a thread in a synchronous
//!    transfer of the same context. Events are handled by one thread at a time; the mutex around the receiver makes that
//!    safe to rely on. A receiver must not use the transport.
//! 5. **Panics** do not cross the boundary: the receiver runs inside `catch_unwind`, and a panic ends the stream.
//! 6. **Cancellation.** After `stopping` is set the event thread cancels every transfer again each time around its loop.
//!    A callback that had read `stopping` before it was set and submits once more is thereby cancelled the next time.
#![expect(
    unsafe_code,
    reason = "libusb's asynchronous interface is one of raw pointers and callbacks; see above for what makes it sound"
)]

use std::{
    ffi::c_void,
    panic::{AssertUnwindSafe, catch_unwind},
    ptr::NonNull,
    sync::{
        Arc, Mutex, PoisonError,
        atomic::{AtomicBool, AtomicUsize, Ordering},
        mpsc,
    },
    thread::{self, JoinHandle},
    time::{Duration, Instant},
};

use libusb1_sys as ffi;
use libusb1_sys::constants as c;
use rusb::UsbContext;

use super::{Arrival, Fault, Flight, Identity, Receiver, Stream, TransportError};
use crate::host_time::host_ns;

type Handle = rusb::DeviceHandle<rusb::Context>;

/// How long cancelled transfers may take to come back.
const PATIENCE: Duration = Duration::from_secs(10);

/// What callbacks, the event thread and the owner share.
struct Shared {
    identity: Identity,
    receiver: Mutex<Receiver>,
    in_flight: AtomicUsize,
    stopping: AtomicBool,
    /// The first fault; `None` while all is well and when the stream was stopped on request.
    fault: Mutex<Option<Fault>>,
}

impl Shared {
    /// Ends the stream because of `fault`, unless it is ending already.
    fn fail(&self, fault: Fault) {
        if !self.stopping.swap(true, Ordering::AcqRel) {
            *self.fault.lock().unwrap_or_else(PoisonError::into_inner) = Some(fault);
        }
    }

    /// Hands data to the receiver. Does not panic.
    fn deliver(&self, arrival: Arrival<'_>) {
        let delivered = catch_unwind(AssertUnwindSafe(|| {
            (self.receiver.lock().unwrap_or_else(PoisonError::into_inner))(arrival);
        }));
        if delivered.is_err() {
            self.fail(Fault::Receiver);
        }
    }

    /// Takes a finished transfer: its status and what it brought.
    fn take(&self, host_ns: i64, status: i32, bytes: &[u8]) {
        if !bytes.is_empty() {
            self.deliver(Arrival::Data { host_ns, bytes });
        }
        match status {
            c::LIBUSB_TRANSFER_COMPLETED | c::LIBUSB_TRANSFER_TIMED_OUT | c::LIBUSB_TRANSFER_CANCELLED => {}
            c::LIBUSB_TRANSFER_STALL => self.fail(Fault::Stall),
            c::LIBUSB_TRANSFER_NO_DEVICE => self.fail(Fault::Gone),
            c::LIBUSB_TRANSFER_OVERFLOW => self.fail(Fault::Overflow),
            other => self.fail(Fault::Io(other)),
        }
    }
}

/// One transfer and the buffer that it fills.
struct Slot {
    transfer: NonNull<ffi::libusb_transfer>,
    _buffer: Box<[u8]>,
}

impl Drop for Slot {
    fn drop(&mut self) {
        // SAFETY: the transfer came from libusb_alloc_transfer and is not in flight (invariant 1).
        unsafe { ffi::libusb_free_transfer(self.transfer.as_ptr()) };
    }
}

/// Everything that libusb has pointers to. Fields drop in this order: transfers, then the device.
struct Flown {
    slots: Vec<Slot>,
    shared: Arc<Shared>,
    handle: Arc<Handle>,
}

// SAFETY: the raw pointers are owned by this value alone, and libusb's functions on transfers may be called from any
// thread.
unsafe impl Send for Flown {}

impl Flown {
    fn cancel_all(&self) {
        for slot in &self.slots {
            // SAFETY: the transfer is allocated. Cancelling one that is not in flight answers "not found" and does
            // nothing else.
            unsafe { ffi::libusb_cancel_transfer(slot.transfer.as_ptr()) };
        }
    }

    /// Handles events until every transfer has come back; runs on the event thread.
    fn run(self) {
        let mut cancelled_at = None;
        while self.shared.in_flight.load(Ordering::Acquire) > 0 {
            match self.handle.context().handle_events(Some(Duration::from_millis(100))) {
                Ok(()) | Err(rusb::Error::Interrupted | rusb::Error::Timeout) => {}
                Err(error) => {
                    self.shared.fail(Fault::of_rusb(error, &self.shared.identity));
                    thread::sleep(Duration::from_millis(10));
                }
            }
            if self.shared.stopping.load(Ordering::Acquire) {
                self.cancel_all();
                let since = *cancelled_at.get_or_insert_with(Instant::now);
                if since.elapsed() > PATIENCE {
                    tracing::error!(device = %self.shared.identity, "cancelled transfers did not come back; leaked");
                    self.finish();
                    std::mem::forget(self);
                    return;
                }
            }
        }
        self.finish();
    }

    /// Tells the receiver of a stream that broke.
    fn finish(&self) {
        let fault = self.shared.fault.lock().unwrap_or_else(PoisonError::into_inner).take();
        if let Some(fault) = fault {
            self.shared.deliver(Arrival::Ended(fault));
        }
    }
}

/// Called by libusb when a transfer has finished, however it did.
extern "system" fn arrived(transfer: *mut ffi::libusb_transfer) {
    let host_ns = host_ns();
    // SAFETY: libusb passes a transfer that `open` submitted; it, its buffer and `Shared` live until `in_flight` has
    // fallen for it (invariants 1 and 2), which happens below. libusb does not touch it until it is submitted again.
    let (shared, finished) = unsafe { (&*((*transfer).user_data as *const Shared), &*transfer) };
    let count = usize::try_from(finished.actual_length.clamp(0, finished.length)).unwrap_or(0);
    // SAFETY: the buffer has `length` bytes, all initialised, of which libusb filled the first `actual_length`.
    let bytes = unsafe { std::slice::from_raw_parts(finished.buffer, count) };
    shared.take(host_ns, finished.status, bytes);
    if !shared.stopping.load(Ordering::Acquire) {
        // SAFETY: the transfer is ours and has finished.
        let code = unsafe { ffi::libusb_submit_transfer(transfer) };
        if code == 0 {
            return;
        }
        // Another program took the memory that this transfer had: go on with those that are left.
        if code != c::LIBUSB_ERROR_NO_MEM || shared.in_flight.load(Ordering::Acquire) <= 1 {
            shared.fail(Fault::of_code(code, &shared.identity));
        }
    }
    shared.in_flight.fetch_sub(1, Ordering::AcqRel);
}

/// A running stream of bulk transfers.
pub(super) struct BulkStream {
    shared: Arc<Shared>,
    handle: Arc<Handle>,
    thread: Option<JoinHandle<()>>,
    granted: usize,
}

impl BulkStream {
    /// Submits transfers and starts the thread that handles their events. Where the kernel refuses memory for some of
    /// them, goes on with those that it took.
    pub(super) fn open(
        handle: Arc<Handle>,
        identity: &Identity,
        endpoint: u8,
        flight: Flight,
        receiver: Receiver,
    ) -> Result<Self, TransportError> {
        let error = |fault| TransportError::new(identity, format!("stream from endpoint {endpoint:#04x}"), fault);
        // The thread comes first: were it to fail once transfers are in flight, nobody could wait for them.
        let (give, take) = mpsc::sync_channel::<Flown>(1);
        let thread = thread::Builder::new()
            .name(format!("usb {}:{}", identity.bus, identity.address))
            .spawn(move || {
                if let Ok(flown) = take.recv() {
                    flown.run();
                }
            })
            .map_err(|_| error(Fault::Memory("the system refuses to start more threads".into())))?;
        let length = i32::try_from(flight.bytes).map_err(|_| error(Fault::Memory(super::budget::memory_advice())))?;
        let shared = Arc::new(Shared {
            identity: identity.clone(),
            receiver: Mutex::new(receiver),
            in_flight: AtomicUsize::new(0),
            stopping: AtomicBool::new(false),
            fault: Mutex::new(None),
        });
        let mut flown = Flown { slots: Vec::new(), shared: Arc::clone(&shared), handle: Arc::clone(&handle) };
        let mut refusal = None;
        for _ in 0..flight.transfers.max(1) {
            // SAFETY: allocates; null means no memory.
            let Some(transfer) = NonNull::new(unsafe { ffi::libusb_alloc_transfer(0) }) else {
                refusal = Some(c::LIBUSB_ERROR_NO_MEM);
                break;
            };
            let mut buffer = vec![0_u8; flight.bytes].into_boxed_slice();
            let target = buffer.as_mut_ptr();
            flown.slots.push(Slot { transfer, _buffer: buffer });
            shared.in_flight.fetch_add(1, Ordering::AcqRel);
            // SAFETY: the transfer and the buffer (whose heap address does not move with the box) are owned by `flown`,
            // as are the device and `Shared` (invariants 1 to 3). A time-out of 0 means none.
            let code = unsafe {
                ffi::libusb_fill_bulk_transfer(
                    transfer.as_ptr(),
                    handle.as_raw(),
                    endpoint,
                    target,
                    length,
                    arrived,
                    Arc::as_ptr(&shared).cast_mut().cast::<c_void>(),
                    0,
                );
                ffi::libusb_submit_transfer(transfer.as_ptr())
            };
            if code != 0 {
                shared.in_flight.fetch_sub(1, Ordering::AcqRel);
                flown.slots.pop();
                refusal = Some(code);
                break;
            }
        }
        let granted = flown.slots.len();
        let hopeless = match refusal {
            Some(c::LIBUSB_ERROR_NO_MEM) => granted == 0,
            other => other.is_some(),
        };
        if hopeless {
            shared.stopping.store(true, Ordering::Release);
        }
        if let Err(mpsc::SendError(flown)) = give.send(flown) {
            flown.run(); // Cannot be: the thread waits for it. Its work must be done all the same.
        }
        let mut stream = Self { shared, handle, thread: Some(thread), granted };
        if hopeless {
            stream.stop();
            return Err(error(Fault::of_code(refusal.unwrap_or(c::LIBUSB_ERROR_OTHER), identity)));
        }
        Ok(stream)
    }
}

impl Stream for BulkStream {
    fn granted(&self) -> usize {
        self.granted
    }

    fn stop(&mut self) {
        self.shared.stopping.store(true, Ordering::Release);
        let Some(thread) = self.thread.take() else { return };
        self.handle.context().interrupt_handle_events();
        if thread.join().is_err() {
            tracing::error!(device = %self.shared.identity, "the event thread panicked");
        }
    }
}

impl Drop for BulkStream {
    fn drop(&mut self) {
        self.stop();
    }
}
