//! Recording of dispatches.

use super::{Binding, Gpu, Kernel};

/// Commands recorded for one submission, run in order.
#[derive(Debug)]
pub struct Commands<'a> {
    gpu: &'a Gpu,
    encoder: wgpu::CommandEncoder,
}

impl Gpu {
    /// Starts a recording.
    pub fn commands(&self) -> Commands<'_> {
        Commands { gpu: self, encoder: self.device.create_command_encoder(&Default::default()) }
    }
}

impl<'a> Commands<'a> {
    /// The device that is recorded for.
    #[must_use]
    pub fn gpu(&self) -> &'a Gpu {
        self.gpu
    }

    /// Runs `groups` workgroups of `kernel`. Beyond 65,535 they are laid out in two dimensions: the kernel computes its
    /// linear workgroup index as `group.y * num_workgroups.x + group.x` and returns where it passes its count.
    pub fn dispatch(&mut self, kernel: &Kernel, bindings: &[Binding<'_>], groups: u32) {
        if groups == 0 {
            return;
        }
        let (x, y) = if groups > 65_535 { (32_768, groups.div_ceil(32_768)) } else { (groups, 1) };
        let bind_group = self.bind_group(kernel, bindings);
        let mut pass = self.pass(kernel);
        pass.set_pipeline(&kernel.pipeline);
        pass.set_bind_group(0, &bind_group, &[]);
        pass.dispatch_workgroups(x, y, 1);
    }

    /// Runs as many workgroups as the three `u32` at byte `offset` of `arguments` say.
    pub fn dispatch_indirect(
        &mut self,
        kernel: &Kernel,
        bindings: &[Binding<'_>],
        arguments: &wgpu::Buffer,
        offset: u64,
    ) {
        let bind_group = self.bind_group(kernel, bindings);
        let mut pass = self.pass(kernel);
        pass.set_pipeline(&kernel.pipeline);
        pass.set_bind_group(0, &bind_group, &[]);
        pass.dispatch_workgroups_indirect(arguments, offset);
    }

    /// Fills a buffer with zeros.
    pub fn clear(&mut self, buffer: &wgpu::Buffer) {
        self.encoder.clear_buffer(buffer, 0, None);
    }

    /// Copies the first `bytes` bytes (a multiple of 4).
    pub fn copy(&mut self, from: &wgpu::Buffer, to: &wgpu::Buffer, bytes: u64) {
        self.encoder.copy_buffer_to_buffer(from, 0, to, 0, bytes);
    }

    /// Hands the recording to the device. The index says what to wait for.
    pub fn submit(self) -> wgpu::SubmissionIndex {
        self.gpu.queue.submit([self.encoder.finish()])
    }

    fn bind_group(&self, kernel: &Kernel, bindings: &[Binding<'_>]) -> wgpu::BindGroup {
        let entries: Vec<_> = bindings
            .iter()
            .zip(0..)
            .map(|(buffer, binding)| wgpu::BindGroupEntry { binding, resource: buffer.as_entire_binding() })
            .collect();
        self.gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some(&kernel.label),
            layout: &kernel.layout,
            entries: &entries,
        })
    }

    fn pass(&mut self, kernel: &Kernel) -> wgpu::ComputePass<'static> {
        self.encoder
            .begin_compute_pass(&wgpu::ComputePassDescriptor { label: Some(&kernel.label), timestamp_writes: None })
            .forget_lifetime()
    }
}
