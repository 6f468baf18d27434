//! Recording of dispatches.

use super::{Binding, Bound, Gpu, Kernel, Submission, timing::Stamps};

/// Commands that are recorded together, run in order.
#[derive(Debug)]
pub struct Commands<'a> {
    gpu: &'a Gpu,
    // Ends before what is recorded besides dispatches, and before the encoder.
    pass: Option<wgpu::ComputePass<'static>>,
    dispatches: u64,
    /// Where kernels are timed.
    stamps: Option<Stamps>,
    encoder: wgpu::CommandEncoder,
}

impl Gpu {
    /// Starts a recording.
    pub fn commands(&self) -> Commands<'_> {
        Commands {
            gpu: self,
            pass: None,
            dispatches: 0,
            stamps: self.times.stamps(),
            encoder: self.device.create_command_encoder(&Default::default()),
        }
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
        if groups > 0 {
            self.run(&self.gpu.bind_again(kernel, bindings), groups);
        }
    }

    /// Runs as many workgroups as the three `u32` at byte `offset` of `arguments` say.
    pub fn dispatch_indirect(
        &mut self,
        kernel: &Kernel,
        bindings: &[Binding<'_>],
        arguments: &wgpu::Buffer,
        offset: u64,
    ) {
        self.run_indirect(&self.gpu.bind_again(kernel, bindings), arguments, offset);
    }

    /// As [`Commands::dispatch`], of what is bound already.
    pub fn run(&mut self, bound: &Bound, groups: u32) {
        if groups == 0 {
            return;
        }
        let (x, y) = if groups > 65_535 { (32_768, groups.div_ceil(32_768)) } else { (groups, 1) };
        self.record(bound, |pass| pass.dispatch_workgroups(x, y, 1));
    }

    /// As [`Commands::dispatch_indirect`], of what is bound already.
    pub fn run_indirect(&mut self, bound: &Bound, arguments: &wgpu::Buffer, offset: u64) {
        self.record(bound, |pass| pass.dispatch_workgroups_indirect(arguments, offset));
    }

    /// Fills a buffer with zeros.
    pub fn clear(&mut self, buffer: &wgpu::Buffer) {
        self.pass = None;
        self.encoder.clear_buffer(buffer, 0, None);
    }

    /// Copies the first `bytes` bytes (a multiple of 4).
    pub fn copy(&mut self, from: &wgpu::Buffer, to: &wgpu::Buffer, bytes: u64) {
        self.pass = None;
        self.encoder.copy_buffer_to_buffer(from, 0, to, 0, bytes);
    }

    /// Hands the recording to the device, after those that [`Gpu::hold_back`] holds back, or has it wait with them.
    pub fn submit(mut self) -> Submission {
        self.pass = None;
        self.gpu.counters.dispatched(self.dispatches);
        let stamps = self.stamps.take().map(|stamps| (stamps.resolve(&self.gpu.device, &mut self.encoder), stamps));
        let submission = self.gpu.hand_over(self.encoder.finish());
        if let Some((buffers, stamps)) = stamps {
            stamps.count(self.gpu, &submission, &buffers);
        }
        submission
    }

    /// Records a dispatch in the pass that is open, each of which sees what those before it wrote.
    fn record(&mut self, bound: &Bound, dispatch: impl FnOnce(&mut wgpu::ComputePass<'_>)) {
        self.dispatches += 1;
        let pass =
            self.pass.get_or_insert_with(|| self.encoder.begin_compute_pass(&Default::default()).forget_lifetime());
        pass.set_pipeline(&bound.pipeline);
        pass.set_bind_group(0, &bound.group, &[]);
        match &mut self.stamps {
            Some(stamps) => stamps.around(&self.gpu.device, pass, &bound.label, dispatch),
            None => dispatch(pass),
        }
    }
}
