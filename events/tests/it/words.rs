//! Words written by hand from the specifications: what they mean is in the tests; the fuzzer starts from them.

/// Prophesee, "EVT 3.0 Format".
pub const EVT3: [u16; 19] = [
    0x8ABC, // time high: 0xABC000 µs
    0x6123, // time low
    0x0064, // row 100
    0x2805, // column 5, ON
    0x2006, // column 6, OFF
    0x3BFF, // base 1023, ON
    0x4003, // columns 1023, 1024
    0x4800, // column 1035 + 11
    0x5081, // columns 1047, 1054
    0xA101, // channel 1 rises
    0x0801, // row 1 of the second camera
    0x2007, 0xE014, // events before the event-rate controller
    0xF123, 0xF456, 0x7007, 0xE016, // a report without payload
    0x6124, 0xA200, // channel 2 falls
];

/// Prophesee, "EVT 2.0 Format".
pub const EVT2: [u32; 12] = [
    0x8000_0002, // time high: 128 µs
    0x1000_0000 | 3 << 22 | 639 << 11 | 479,
    4 << 22 | 1279 << 11 | 719,
    0xA000_0000 | 5 << 22 | 17 << 8 | 1,
    0xE000_0000 | 6 << 22 | 0x0014,
    0xF000_0000 | 0x123_4567,
    0xE000_0000 | 7 << 22 | 0x0016,
    0x8000_0003,
    1280 << 11,
    720,
    0xF000_0000,
    0x7000_0000,
];

/// Prophesee, "EVT 2.1 Format": type, time and address, then the payload.
pub const EVT21: [(u32, u32); 5] = [
    (0x8000_0002, 0),
    (0x1000_0000 | 3 << 22 | 64 << 11 | 479, 0x8000_0001),
    (4 << 22 | 1248 << 11 | 719, 0xC000_0000),
    (0xA000_0000 | 5 << 22 | 1 << 8, 0),
    (0xE000_0000 | 6 << 22 | 0x0014, 0xF123_4567),
];

/// The words of a DAVIS, as libcaer explains them.
pub const DAVIS: [u16; 14] = [
    0x8005, // 5 µs
    0x1003, // row 3
    0x2004, // column 4, OFF
    0x3005, // column 5, ON
    0x7002, // two roll-overs
    0x8001, // 2 * 32768 + 1 µs
    0x3000, //
    0x0003, // the input rises
    0x0002, // and falls
    0x1004, // a row outside
    0x2000, //
    0x0001, // the clock starts again
    0x8007, // 7 µs
    0x0004, // a pulse
];

/// Addresses of a DAVIS346 and times, as jAER writes them.
pub const AEDAT2: [(u32, u32); 5] =
    [(259 << 22 | 3 << 12 | 1 << 11, 10), (345 << 12, 0x7FFF_FFFF), (1 << 31, 0), (1 << 10, 5), (260 << 22, 6)];
