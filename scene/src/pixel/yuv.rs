//! YUV with shared chroma. BT.601 with Y from 16 to 235, the default of the USB Video Class (UVC 1.5, section 3.9.2.6).
//! Chroma is repeated, not interpolated: these pictures are for looking, and for exports that keep the camera's resolution.

/// Packed 4:2:2, Y0 U Y1 V.
pub(super) fn yuyv(payload: &[u8]) -> Vec<u8> {
    payload.chunks_exact(4).flat_map(|p| two_pixels(p[0], p[2], p[1], p[3])).collect()
}

/// Packed 4:2:2, U Y0 V Y1.
pub(super) fn uyvy(payload: &[u8]) -> Vec<u8> {
    payload.chunks_exact(4).flat_map(|p| two_pixels(p[1], p[3], p[0], p[2])).collect()
}

/// 4:2:0, a plane of Y and one of interleaved UV.
pub(super) fn nv12(width: usize, height: usize, payload: &[u8]) -> Vec<u8> {
    let (luma, chroma) = payload.split_at(width * height);
    let rows = luma.chunks_exact(width).enumerate();
    rows.flat_map(|(row, luma)| {
        let chroma = &chroma[row / 2 * width..][..width];
        luma.chunks_exact(2).zip(chroma.chunks_exact(2)).flat_map(|(y, uv)| two_pixels(y[0], y[1], uv[0], uv[1]))
    })
    .collect()
}

/// Two neighbours that share their chroma.
fn two_pixels(y0: u8, y1: u8, u: u8, v: u8) -> [u8; 6] {
    let ([r0, g0, b0], [r1, g1, b1]) = (rgb(y0, u, v), rgb(y1, u, v));
    [r0, g0, b0, r1, g1, b1]
}

/// BT.601, Y from 16 to 235, in 1/65536.
#[must_use]
pub fn rgb(y: u8, u: u8, v: u8) -> [u8; 3] {
    let y = 76_309 * (i32::from(y) - 16);
    let (u, v) = (i32::from(u) - 128, i32::from(v) - 128);
    let byte = |value: i32| ((value + 32_768) >> 16).clamp(0, 255) as u8;
    [byte(y + 104_597 * v), byte(y - 25_675 * u - 53_279 * v), byte(y + 132_201 * u)]
}
