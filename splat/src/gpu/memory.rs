//! How much memory an adapter has of its own.

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
