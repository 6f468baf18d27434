use erfgs_base::random::key;

use super::*;
use crate::gpu::{AdapterChoice, Gpu, Shape};

fn gpu() -> Gpu {
    Gpu::open(&AdapterChoice { name: None, shape: Some(Shape::Gpu) }).expect("an adapter")
}

#[test]
fn prefix_sums_agree_with_a_loop() {
    let gpu = gpu();
    let prefix_sum = PrefixSum::new(&gpu);
    for count in [0, 1, 255, 2048, 2049, 600_000] {
        let numbers: Vec<u32> = (0..count).map(|i| (key(1, &[i]) % 100) as u32).collect();
        let mut sum = 0;
        let before = |n: &u32| {
            sum += n;
            sum - n
        };
        let expected: Vec<u32> = numbers.iter().map(before).collect();
        let buffer = gpu.storage_from("numbers", &numbers).expect("room");
        let plan = gpu.storage_from("plan", &[Plan::scan(count as u32)]).expect("room");
        let scratch = ScanBuffers::new(&gpu, count as u32).expect("room");
        let mut commands = gpu.commands();
        prefix_sum.record(&mut commands, &plan, &buffer, &scratch);
        commands.submit();
        assert_eq!(gpu.download::<u32>(&buffer, count as usize).expect("a read back"), expected, "{count}");
        assert_eq!(gpu.download::<Plan>(&plan, 1).expect("a read back")[0].total[0], sum, "{count}");
        // By one workgroup, as a sort does where there are few.
        gpu.upload(&buffer, 0, &numbers);
        let mut commands = gpu.commands();
        prefix_sum.bind(&gpu, &plan, &buffer, &scratch, 0).record(&mut commands, &plan);
        commands.submit();
        assert_eq!(gpu.download::<u32>(&buffer, count as usize).expect("a read back"), expected, "{count} at once");
    }
}

#[test]
fn sums_saturate() {
    let gpu = gpu();
    let prefix_sum = PrefixSum::new(&gpu);
    let buffer = gpu.storage_from("numbers", &vec![1u32 << 29; 5000]).expect("room");
    let plan = gpu.storage_from("plan", &[Plan::scan(5000)]).expect("room");
    let scratch = ScanBuffers::new(&gpu, 5000).expect("room");
    let mut commands = gpu.commands();
    prefix_sum.record(&mut commands, &plan, &buffer, &scratch);
    commands.submit();
    let sums = gpu.download::<u32>(&buffer, 5000).expect("a read back");
    assert_eq!((sums[7], sums[8], sums[4999]), (7 << 29, u32::MAX, u32::MAX));
}

#[test]
fn pairs_are_sorted_stably() {
    let gpu = gpu();
    let sort = RadixSort::new(&gpu);
    // From 2,097,153 pairs on there are more counts than one workgroup adds up.
    let cases =
        [(0u32, 32, 0), (1, 32, 1), (2047, 32, 2047), (70_001, 32, 70_001), (70_001, 6, 80_000), (4097, 13, 2_100_000)];
    for (count, bits, room) in cases {
        // Few distinct keys, so that stability matters.
        let mask = if bits == 32 { 0xf000_00ff } else { (1 << bits) - 1 };
        let keys: Vec<u32> = (0..u64::from(count)).map(|i| key(2, &[i]) as u32 & mask).collect();
        let mut expected: Vec<(u32, u32)> = keys.iter().copied().zip(0..).collect();
        expected.sort_by_key(|pair| pair.0);
        let buffers = sort.buffers(&gpu, "test", room).expect("room");
        gpu.upload(&buffers.plan, 0, &[Plan::sort(count)]);
        // Where the host knows how many there are, and where the device alone does.
        for known in [Some(count), None] {
            gpu.upload(&buffers.keys, 0, &keys);
            gpu.upload(&buffers.values, 0, &(0..count).collect::<Vec<u32>>());
            let mut commands = gpu.commands();
            buffers.sort(&mut commands, bits, known);
            commands.submit();
            let sorted = gpu.download::<u32>(&buffers.keys, count as usize).expect("a read back");
            let values = gpu.download::<u32>(&buffers.values, count as usize).expect("a read back");
            let pairs: Vec<_> = sorted.into_iter().zip(values).collect();
            assert_eq!(pairs, expected, "{count} pairs of {bits} bits, known: {known:?}");
        }
    }
}
