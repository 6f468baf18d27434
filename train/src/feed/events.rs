//! Events on the device, and the counts between any two instants, which are made there. Sums are of integers: they are the same in any
//! order, and whether the device adds them up or the host.

use std::ops::Range;

use bytemuck::{Pod, Zeroable};
use wgpu::Buffer;

use super::{
    FeedError,
    frames::{AT_ONCE, arrive},
};
use crate::{
    kernels::kernel,
    losses::LEFT_OUT,
    scene::{EventView, Numbers, Way},
};
use erfgs_splat::gpu::{Commands, Gpu, GpuError, Kernel, Shape, stored};

/// Numbers of a buffer of events or of images of counts: 64 MiB. Every adapter binds so many.
const NUMBERS: usize = 16 << 20;

/// The events of all cameras that are learned from.
#[derive(Debug)]
pub(crate) struct Events {
    start: Kernel,
    add: Kernel,
    signed: Kernel,
    cameras: Vec<Camera>,
    /// ON and OFF events of each pixel of the camera that is looked at.
    sums: Buffer,
    /// Bound where a kernel looks at nothing.
    nothing: Buffer,
    /// Numbers and events that a thread looks at.
    a_thread: u32,
}

/// One of them.
#[derive(Debug)]
struct Camera {
    /// What an ON and an OFF event change at each pixel, where pixels tell.
    steps: Option<Buffer>,
    /// Nothing where the host adds up.
    resident: Option<Resident>,
}

#[derive(Debug)]
struct Resident {
    events: Long,
    images: Long,
}

/// Numbers in as many buffers as they need.
#[derive(Debug)]
struct Long {
    buffers: Vec<Buffer>,
    /// In each but the last.
    numbers: usize,
}

#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct StartParameters {
    words: u32,
    threads: u32,
    images: u32,
    from: [u32; 2],
    unused: [u32; 3],
}

#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct AddParameters {
    first: u32,
    events: u32,
    threads: u32,
    step: u32,
}

#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct SignedParameters {
    pixels: u32,
    own_steps: u32,
    in_region: u32,
    drift: f32,
    step: [f32; 2],
    unused: [u32; 2],
}

impl Long {
    /// Uploads `count` numbers of a kind, `numbers` a buffer.
    fn new(gpu: &Gpu, events: &EventView, kind: Numbers, count: usize, numbers: usize) -> Result<Self, FeedError> {
        let mut buffers = Vec::new();
        let mut on_the_way = 0;
        for first in (0..count).step_by(numbers) {
            let length = numbers.min(count - first);
            let buffer = gpu.storage("events", 4 * length as u64)?;
            events.read(kind, first..first + length, |before, piece| gpu.upload(&buffer, 4 * before as u64, piece))?;
            buffers.push(buffer);
            on_the_way += 4 * length as u64;
            if on_the_way >= AT_ONCE {
                arrive(gpu)?;
                on_the_way = 0;
            }
        }
        arrive(gpu)?;
        Ok(Self { buffers, numbers })
    }

    /// The buffers that hold a range of numbers, and which of theirs.
    fn pieces(&self, range: Range<usize>) -> impl Iterator<Item = (&Buffer, Range<usize>)> {
        let Range { start, end } = range;
        let buffers = self.buffers.iter().zip(0..).skip(start / self.numbers);
        let begins = buffers.map(|(buffer, index)| (buffer, index * self.numbers));
        begins
            .take_while(move |(_, begins)| *begins < end && start < end)
            .map(move |(buffer, begins)| (buffer, start.max(begins) - begins..end.min(begins + self.numbers) - begins))
    }
}

impl Resident {
    fn new(gpu: &Gpu, events: &EventView, numbers: usize) -> Result<Self, FeedError> {
        let [count, of_images] = events.numbers();
        // An image lies in one buffer.
        let image = 2 * events.pixels().max(1);
        let images = (numbers / image).max(1) * image;
        Ok(Self {
            events: Long::new(gpu, events, Numbers::Events, count, numbers)?,
            images: Long::new(gpu, events, Numbers::Images, of_images, images)?,
        })
    }
}

impl Events {
    /// These cameras, whose events the host adds up.
    ///
    /// # Errors
    /// [`GpuError`] where the device has no room.
    pub fn new(gpu: &Gpu, cameras: &[EventView]) -> Result<Self, GpuError> {
        let most = cameras.iter().map(EventView::pixels).max().unwrap_or(0);
        let camera = |events: &EventView| {
            let (_, own) = events.steps();
            let steps = (!own.is_empty()).then(|| gpu.storage_from("steps of pixels", own)).transpose()?;
            Ok(Camera { steps, resident: None })
        };
        let left_out = format!("const LEFT_OUT = {LEFT_OUT:e}f;");
        Ok(Self {
            start: kernel(gpu, "count start", &[include_str!("count_start.wgsl")]),
            add: kernel(gpu, "count add", &[include_str!("count_add.wgsl")]),
            signed: kernel(gpu, "count signed", &[&left_out, include_str!("count_signed.wgsl")]),
            cameras: cameras.iter().map(camera).collect::<Result<_, GpuError>>()?,
            sums: gpu.storage("events of pixels", Self::size_of_sums(most))?,
            nothing: gpu.storage("nothing", 16)?,
            a_thread: match gpu.shape {
                Shape::Gpu => 1,
                Shape::Cpu => 64,
            },
        })
    }

    /// Bytes of the device's memory that counting the events of these cameras takes, wherever they lie.
    pub fn bytes_to_count(cameras: &[EventView]) -> u64 {
        let most = cameras.iter().map(EventView::pixels).max().unwrap_or(0);
        let steps = cameras.iter().map(|events| events.steps().1).filter(|own| !own.is_empty());
        stored(Self::size_of_sums(most)) + steps.map(|own| stored(size_of_val(own) as u64)).sum::<u64>()
    }

    fn size_of_sums(pixels: usize) -> u64 {
        8 * pixels as u64
    }

    /// Bytes that the events of a camera take.
    pub fn bytes(events: &EventView) -> u64 {
        events.numbers().map(|numbers| 4 * numbers as u64).iter().sum()
    }

    /// Uploads the events of the cameras that come first, as many as take no more than `most` bytes together; how many bytes those are.
    ///
    /// # Errors
    /// [`FeedError`].
    pub fn fill(&mut self, gpu: &Gpu, cameras: &[EventView], most: u64) -> Result<u64, FeedError> {
        self.fill_by(gpu, cameras, most, NUMBERS)
    }

    /// The same, with so many numbers in a buffer.
    fn fill_by(&mut self, gpu: &Gpu, cameras: &[EventView], most: u64, numbers: usize) -> Result<u64, FeedError> {
        let mut taken: u64 = 0;
        for (camera, events) in self.cameras.iter_mut().zip(cameras) {
            let bytes = Self::bytes(events);
            if taken.saturating_add(bytes) <= most {
                camera.resident = Some(Resident::new(gpu, events, numbers)?);
                taken += bytes;
            }
        }
        Ok(taken)
    }

    /// Writes the signed counts of all pixels of camera `index` between two edges to `count`: those of [`EventView::between`], and
    /// [`LEFT_OUT`] outside of a `region`.
    ///
    /// # Errors
    /// [`SceneError`](crate::scene::SceneError) where events lie in a file that cannot be read any more.
    #[expect(clippy::too_many_arguments, reason = "where, of whom, from when to when, and where not")]
    pub fn count(
        &self,
        gpu: &Gpu,
        commands: &mut Commands<'_>,
        index: usize,
        events: &EventView,
        [from, to]: [usize; 2],
        region: Option<&Buffer>,
        count: &Buffer,
    ) -> Result<(), FeedError> {
        let camera = &self.cameras[index];
        match &camera.resident {
            Some(resident) => self.add_up(gpu, commands, resident, &events.way(from, to), events.pixels()),
            None => gpu.upload(&self.sums, 0, &events.pairs(from, to)?),
        }
        let (step, _) = events.steps();
        let parameters = SignedParameters {
            pixels: events.pixels() as u32,
            own_steps: camera.steps.is_some().into(),
            in_region: region.is_some().into(),
            drift: events.drift_between(from, to),
            step,
            unused: [0; 2],
        };
        let parameters = gpu.uniform("count signed", &parameters);
        let (steps, region) = (camera.steps.as_ref().unwrap_or(&self.nothing), region.unwrap_or(&self.nothing));
        let bindings = [&parameters, &self.sums, steps, region, count];
        commands.dispatch(&self.signed, &bindings, (events.pixels() as u32).div_ceil(64));
        Ok(())
    }

    fn add_up(&self, gpu: &Gpu, commands: &mut Commands<'_>, resident: &Resident, way: &Way, pixels: usize) {
        let words = 2 * pixels;
        let image = |which: Option<usize>| {
            let mut pieces = which.map(|image| resident.images.pieces(image * words..(image + 1) * words));
            pieces
                .as_mut()
                .and_then(Iterator::next)
                .map_or((&self.nothing, 0), |(buffer, at)| (buffer, at.start as u32))
        };
        let [more, less] = way.images.map(image);
        let threads = (words as u32).div_ceil(self.a_thread).max(1);
        let parameters = StartParameters {
            words: words as u32,
            threads,
            images: u32::from(way.images[0].is_some()) | u32::from(way.images[1].is_some()) << 1,
            from: [more.1, less.1],
            unused: [0; 3],
        };
        let parameters = gpu.uniform("count start", &parameters);
        commands.dispatch(&self.start, &[&parameters, more.0, less.0, &self.sums], threads.div_ceil(64));
        for (events, more) in &way.events {
            for (buffer, piece) in resident.events.pieces(events.clone()) {
                let events = piece.len() as u32;
                let threads = events.div_ceil(self.a_thread).max(1);
                let step = if *more { 1 } else { u32::MAX };
                let parameters = AddParameters { first: piece.start as u32, events, threads, step };
                let parameters = gpu.uniform("count add", &parameters);
                commands.dispatch(&self.add, &[&parameters, buffer, &self.sums], threads.div_ceil(64));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use erfgs_base::random::{below, key};
    use erfgs_splat::gpu::AdapterChoice;

    use super::*;
    use crate::{reference::counts as twin, scene::fixtures};

    const SIZE: [u32; 2] = [7, 5];
    const PIXELS: usize = 35;
    const BINS: usize = 40;

    /// Bins with nothing, with little and with more than there are pixels. Where the light flickers, most pixels return to where they were
    /// in each, in three steps up and four down.
    fn bins(flickers: bool) -> Vec<Vec<(usize, bool)>> {
        let bin = |bin: usize| {
            let draw = |what: usize, limit: usize| below(key(bin as u64, &[what as u64]), limit as u64) as usize;
            let size = [0, 3, 20, 90][draw(1000, 4)];
            let flicker =
                (0..if flickers { PIXELS - 9 } else { 0 }).flat_map(|pixel| (0..7).map(move |step| (pixel, step < 3)));
            flicker.chain((0..size).map(|at| (draw(2 * at, PIXELS), draw(2 * at + 1, 2) == 1))).collect()
        };
        (0..BINS).map(bin).collect()
    }

    fn counted(gpu: &Gpu, events: &Events, view: &EventView, edges: [usize; 2], region: Option<&Buffer>) -> Vec<f32> {
        let count = gpu.storage("count", 4 * PIXELS as u64).expect("a buffer");
        let mut commands = gpu.commands();
        events.count(gpu, &mut commands, 0, view, edges, region, &count).expect("memory");
        commands.submit();
        gpu.download(&count, PIXELS).expect("counts")
    }

    #[test]
    fn counts_on_the_device_are_those_of_the_host_and_of_the_twin() {
        for shape in [Shape::Cpu, Shape::Gpu] {
            let gpu = Gpu::open(&AdapterChoice { shape: Some(shape), ..Default::default() }).expect("an adapter");
            for flickers in [false, true] {
                check(&gpu, flickers);
            }
        }
    }

    fn check(gpu: &Gpu, flickers: bool) {
        let bins = bins(flickers);
        let views = [fixtures::seen(SIZE, &bins, flickers)];
        let [view] = &views;
        let [numbers, of_images] = view.numbers();
        assert!(of_images > 4 * 2 * PIXELS, "{of_images}: some edges are known");
        let (step, own) = view.steps();
        assert_eq!(own.iter().any(|own| *own != step), flickers, "pixels tell of their own thresholds");
        let bits = [0x5a5a_5a5a_u32, 0x6];
        let region = gpu.storage_from("region", &bits).expect("a buffer");
        let is_in = |pixel: usize| bits[pixel / 32] >> (pixel % 32) & 1 == 1;
        let fresh = || Events::new(gpu, &views).expect("buffers");
        let (by_host, [mut resident, mut in_pieces]) = (fresh(), [fresh(), fresh()]);
        let bytes = Events::bytes(view);
        assert_eq!(bytes, 4 * (numbers + of_images) as u64);
        assert_eq!(resident.fill(gpu, &views, bytes - 1).expect("memory"), 0, "there is no room");
        assert!(resident.cameras[0].resident.is_none());
        assert_eq!(resident.fill(gpu, &views, bytes).expect("memory"), bytes);
        // Several images a buffer, and many buffers of events.
        assert_eq!(in_pieces.fill_by(gpu, &views, bytes, 2 * 2 * PIXELS + 11).expect("memory"), bytes);
        let held = in_pieces.cameras[0].resident.as_ref().expect("events");
        assert!(held.events.buffers.len() > 2 && held.images.buffers.len() > 2);
        let mut ways = [0; 2];
        for (from, to) in (0..=BINS).flat_map(|from| (from..=BINS).map(move |to| (from, to))).step_by(5) {
            let between = view.between(from, to).expect("memory");
            let span = format!("{from} to {to}");
            for events in [&by_host, &resident, &in_pieces] {
                assert_eq!(counted(gpu, events, view, [from, to], None), between, "{span}");
                let within = counted(gpu, events, view, [from, to], Some(&region));
                let left_out = |(pixel, count): (usize, &f32)| if is_in(pixel) { *count } else { LEFT_OUT };
                assert!(within.into_iter().eq(between.iter().enumerate().map(left_out)), "{span}");
            }
            let one = |pixel: usize| own.get(pixel).copied().unwrap_or(step).map(f64::from);
            let drift = f64::from(view.drift_between(from, to));
            let drift = |pixel: usize| if own.get(pixel).is_none_or(|own| *own == step) { drift } else { 0.0 };
            let twin = twin::signed(&bins[from..to], PIXELS, one, drift);
            for (got, want) in between.iter().zip(twin) {
                assert!((f64::from(*got) - want).abs() <= 1e-5 * want.abs().max(10.0), "{span}: {got}, {want}");
            }
            let way = view.way(from, to);
            ways[usize::from(way.images.iter().any(Option::is_some))] += 1;
        }
        assert!(ways.iter().all(|&ways| ways > 10), "{ways:?}: some from images, some from events alone");
    }
}
