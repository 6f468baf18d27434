//! How much memory an adapter has of its own, and how much of it is taken.

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering::Relaxed};

use super::Gpu;

/// Bytes that a storage buffer for so many bytes has: see [`Gpu::storage`].
#[must_use]
pub const fn stored(bytes: u64) -> u64 {
    let bytes = if bytes < 16 { 16 } else { bytes };
    bytes.next_multiple_of(16)
}

/// The most bytes that buffers took at once, while that is watched.
#[derive(Debug, Default)]
pub(super) struct Watched {
    is_on: AtomicBool,
    most: AtomicU64,
}

impl Gpu {
    /// Bytes that all buffers take now, those of wgpu itself included; `None` where the backend does not count them.
    pub fn memory_taken(&self) -> Option<u64> {
        self.device.generate_allocator_report().map(|report| report.total_allocated_bytes)
    }

    /// From now on it is counted how much is taken, whenever something is made or written: slower, for tests and measurements.
    pub fn watch_memory(&self) {
        self.watched.is_on.store(true, Relaxed);
        self.look_at_memory();
    }

    /// The most bytes that buffers took at once since [`Gpu::watch_memory`]; `None` where nobody watched, or nobody counts.
    pub fn most_memory_taken(&self) -> Option<u64> {
        Some(self.watched.most.load(Relaxed)).filter(|&most| most > 0)
    }

    /// Told after something was made.
    pub(super) fn look_at_memory(&self) {
        if self.watched.is_on.load(Relaxed) {
            self.watched.most.fetch_max(self.memory_taken().unwrap_or(0), Relaxed);
        }
    }
}

/// Bytes of the memory that is the adapter's own; `None` where it shares the processor's, or nobody says.
#[cfg(any(target_os = "linux", windows))]
#[expect(unsafe_code, reason = "wgpu does not say how much memory an adapter has, and Vulkan does")]
pub(super) fn own(adapter: &wgpu::Adapter) -> Option<u64> {
    /// `VK_MEMORY_HEAP_DEVICE_LOCAL_BIT`.
    const OF_THE_DEVICE: u32 = 1;
    if !matches!(adapter.get_info().device_type, wgpu::DeviceType::DiscreteGpu | wgpu::DeviceType::VirtualGpu) {
        return None;
    }
    // SAFETY: Nothing of the adapter is destroyed, and nothing is asked for but its properties.
    let adapter = unsafe { adapter.as_hal::<wgpu::hal::api::Vulkan>() }?;
    let instance = adapter.shared_instance().raw_instance();
    // SAFETY: The physical device is of this instance, and both live as long as the adapter.
    let memory = unsafe { instance.get_physical_device_memory_properties(adapter.raw_physical_device()) };
    let heaps = memory.memory_heaps.iter().take(memory.memory_heap_count as usize);
    heaps.filter(|heap| heap.flags.as_raw() & OF_THE_DEVICE != 0).map(|heap| heap.size).max()
}

/// Bytes of the memory that is the adapter's own; `None` where it shares the processor's, or nobody says.
#[cfg(not(any(target_os = "linux", windows)))]
pub(super) fn own(_adapter: &wgpu::Adapter) -> Option<u64> {
    None
}
