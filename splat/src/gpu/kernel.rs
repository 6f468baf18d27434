//! Compute kernels: WGSL text with its shared parts, one entry point `main`, one bind group.

use std::sync::{
    Arc,
    atomic::{AtomicU64, Ordering},
};

use super::Gpu;

/// A buffer as a kernel sees it, in the order of its `@binding` numbers.
pub type Binding<'a> = &'a wgpu::Buffer;

/// A compiled compute kernel.
#[derive(Debug)]
pub struct Kernel {
    /// Which of the process.
    number: u64,
    pub(super) label: Arc<str>,
    pub(super) pipeline: wgpu::ComputePipeline,
    pub(super) layout: wgpu::BindGroupLayout,
}

/// A kernel with its bindings, to run as it is again and again.
#[derive(Debug)]
pub struct Bound {
    pub(super) label: Arc<str>,
    pub(super) pipeline: wgpu::ComputePipeline,
    pub(super) group: wgpu::BindGroup,
}

impl Gpu {
    /// Compiles a kernel of this crate; see [`Self::trusted_kernel`].
    #[expect(unsafe_code, reason = "a test reads the loops of this crate's kernels")]
    pub(crate) fn kernel(&self, label: &str, parts: &[&str]) -> Kernel {
        // SAFETY: Each loop of this crate's kernels counts towards a bound, which a test reads off them (`tests/rooms/kernels.rs`).
        unsafe { self.trusted_kernel(label, parts) }
    }

    /// Compiles a kernel without wgpu's own counter in each loop. `parts` are joined in order: constants first, then shared WGSL, then
    /// the stage itself, whose entry point is `main` and whose bindings are all in group 0, numbered from 0, each used by the kernel.
    ///
    /// A WGSL error surfaces at the next [`Gpu::wait`].
    ///
    /// # Safety
    /// Each loop has to end by itself: its counter goes by steps other than 0 towards a bound. A loop that never ends is undefined
    /// behaviour.
    #[must_use]
    #[expect(
        unsafe_code,
        reason = "wgpu's own counter in each loop costs the backward blending of a graphics processor half its speed"
    )]
    pub unsafe fn trusted_kernel(&self, label: &str, parts: &[&str]) -> Kernel {
        let source = parts.join("\n");
        let text = wgpu::ShaderModuleDescriptor { label: Some(label), source: wgpu::ShaderSource::Wgsl(source.into()) };
        let checks = wgpu::ShaderRuntimeChecks { force_loop_bounding: false, ..wgpu::ShaderRuntimeChecks::checked() };
        // SAFETY: Without a counter of its own in each loop, a loop that never ends would be undefined; the caller has none. All other
        // checks stay.
        let module = unsafe { self.device.create_shader_module_trusted(text, checks) };
        let pipeline = self.device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: Some(label),
            layout: None,
            module: &module,
            entry_point: Some("main"),
            compilation_options: wgpu::PipelineCompilationOptions {
                zero_initialize_workgroup_memory: false,
                ..Default::default()
            },
            cache: None,
        });
        let layout = pipeline.get_bind_group_layout(0);
        static MADE: AtomicU64 = AtomicU64::new(0);
        Kernel { number: MADE.fetch_add(1, Ordering::Relaxed), label: label.into(), pipeline, layout }
    }

    /// Binds buffers to a kernel, in the order of its `@binding` numbers.
    pub fn bind(&self, kernel: &Kernel, bindings: &[Binding<'_>]) -> Bound {
        self.bound(kernel, self.group(kernel, bindings))
    }

    /// The same for a dispatch that the next iteration will hardly differ from.
    pub(super) fn bind_again(&self, kernel: &Kernel, bindings: &[Binding<'_>]) -> Bound {
        self.bound(kernel, self.reused.group(kernel.number, bindings, || self.group(kernel, bindings)))
    }

    fn bound(&self, kernel: &Kernel, group: wgpu::BindGroup) -> Bound {
        Bound { label: Arc::clone(&kernel.label), pipeline: kernel.pipeline.clone(), group }
    }

    fn group(&self, kernel: &Kernel, bindings: &[Binding<'_>]) -> wgpu::BindGroup {
        let entries: Vec<_> = bindings
            .iter()
            .zip(0..)
            .map(|(buffer, binding)| wgpu::BindGroupEntry { binding, resource: buffer.as_entire_binding() })
            .collect();
        self.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some(&kernel.label),
            layout: &kernel.layout,
            entries: &entries,
        })
    }
}
