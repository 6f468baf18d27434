//! What each surface looks like: its diffuse albedo in linear light, at a place on the surface.
//!
//! Sizes are chosen so that a camera of 160 pixels across the room still resolves the patterns, which feature matchers
//! and the trainer alike live on.

use erfgs_base::random;
use glam::{DVec2, DVec3};

use super::{
    colour::hex,
    texture::{checks, fractal_noise, glyphs, interval, pulse, step},
};

/// The looks there are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Paint {
    Floor,
    Ceiling,
    BackWall,
    FrontWall,
    LeftWall,
    RightWall,
    Crate,
    Books,
    Drum,
    Globe,
    Steel,
    Timber,
    Ball,
    Bob,
    Rod,
    /// A blade of the fan; the colour goes by its number.
    Blade(u8),
    /// Of one colour, one of eight.
    Plain(u8),
    /// Patches and spots throughout the body, of one of eleven sets of colours (the last three are dark); the size of the patches in
    /// thousandths of the surface's unit.
    Motley(u8, u16),
}

/// Albedo (linear RGB) at `at`: metres on the surface, or the unit vector from the centre of a sphere. `footprint` is
/// the width to average over, in the unit of `at`.
pub(crate) fn albedo(paint: Paint, seed: u64, at: DVec3, footprint: f64) -> DVec3 {
    let seed = random::key(seed, &[paint_number(paint)]);
    match paint {
        Paint::Floor => floor(seed, at, footprint),
        Paint::Ceiling => mottled(seed, at, footprint, hex(0xE9E2D3), 0.10),
        Paint::BackWall => back_wall(seed, at, footprint),
        Paint::FrontWall => mottled(seed, at, footprint, hex(0xC9BBA4), 0.25),
        Paint::LeftWall => bricks(seed, at, footprint),
        Paint::RightWall => wallpaper(seed, at, footprint),
        Paint::Crate => crate_planks(seed, at, footprint),
        Paint::Books => books(seed, at, footprint),
        Paint::Drum => drum(seed, at, footprint),
        Paint::Globe => globe(seed, at, footprint),
        Paint::Steel => mottled(seed, at, footprint, hex(0x6C747C), 0.25),
        Paint::Timber => wood(seed, DVec3::new(at.y, at.x, at.z), footprint, hex(0x6B4A2F)),
        Paint::Ball => octants(seed, at, footprint, [hex(0xE2571E), hex(0xF6E7C8)], hex(0x27418C)),
        Paint::Bob => octants(seed, at, footprint, [hex(0x1F8A8C), hex(0xF3D36B)], hex(0x5A2340)),
        Paint::Rod => mottled(seed, at, footprint, hex(0x4A4540), 0.1),
        Paint::Blade(number) => blade(seed, at, footprint, number),
        Paint::Plain(look) => hex(LOOKS[usize::from(look) % 8][0]),
        Paint::Motley(look, cell) => {
            motley(seed, at, footprint, LOOKS[usize::from(look) % 11], 0.001 * f64::from(cell))
        }
    }
}

fn paint_number(paint: Paint) -> u64 {
    match paint {
        Paint::Floor => 0,
        Paint::Ceiling => 1,
        Paint::BackWall => 2,
        Paint::FrontWall => 3,
        Paint::LeftWall => 4,
        Paint::RightWall => 5,
        Paint::Crate => 6,
        Paint::Books => 7,
        Paint::Drum => 8,
        Paint::Globe => 9,
        Paint::Steel => 10,
        Paint::Timber => 11,
        Paint::Ball => 12,
        Paint::Bob => 13,
        Paint::Rod => 14,
        Paint::Blade(number) => 16 + u64::from(number),
        Paint::Plain(look) => 512 + u64::from(look),
        Paint::Motley(look, _) => 1024 + u64::from(look),
    }
}

fn mix(a: DVec3, b: DVec3, share: f64) -> DVec3 {
    a + (b - a) * share
}

/// A colour made lighter or darker by `by` (0 leaves it), kept a possible albedo.
fn shaded(colour: DVec3, by: f64) -> DVec3 {
    (colour * (1.0 + by).max(0.15)).min(DVec3::splat(0.95))
}

/// A random number in [0, 1) that belongs to a cell of a pattern.
fn dice(seed: u64, x: f64, y: f64) -> f64 {
    random::uniform(random::key(seed, &[x as i64 as u64, y as i64 as u64]))
}

fn mottled(seed: u64, at: DVec3, footprint: f64, colour: DVec3, depth: f64) -> DVec3 {
    shaded(colour, depth * fractal_noise(seed, at, 0.22, 4, footprint))
}

/// Wood whose grain runs along x.
fn wood(seed: u64, at: DVec3, footprint: f64, colour: DVec3) -> DVec3 {
    let stretched = DVec3::new(at.x * 0.2, at.y, at.z);
    let grain = fractal_noise(seed, stretched, 0.05, 3, footprint);
    shaded(colour, 0.28 * grain + 0.22 * fractal_noise(seed ^ 1, at, 0.3, 2, footprint))
}

/// Floorboards with a rug.
fn floor(seed: u64, at: DVec3, footprint: f64) -> DVec3 {
    let (width, length) = (0.17, 1.1);
    // The room hands the floor's (x, z) in the first two coordinates.
    let row = (at.y / width).floor();
    let along = at.x / length + dice(seed, row, 0.0);
    let board = along.floor();
    let tone = dice(seed, row, board + 1.0);
    let colour = mix(hex(0x8A5A33), hex(0xC08A55), tone);
    let mut boards = wood(seed, at.with_z(0.37 * row), footprint, colour);
    let seam = |x: f64, size: f64| interval((x - x.round()) * size, 0.008, footprint);
    boards *= 1.0 - 0.65 * seam(at.y / width, width).max(seam(along, length));

    // The rug: a border of stripes about diamonds, frayed by noise.
    let centre = DVec2::new(0.05, 0.0);
    let p = DVec2::new(at.x, at.y) - centre;
    let (rim_x, rim_z) = (1.05 - p.x.abs(), 0.62 - p.y.abs());
    let rim = rim_x.min(rim_z);
    let diamonds = checks(DVec2::new(p.x + p.y, p.x - p.y) / 0.2, footprint / 0.14);
    let field = mix(hex(0xA8322D), hex(0xE0B25A), diamonds * step(rim - 0.2, footprint));
    let border = mix(hex(0x22345C), hex(0xEBDDBB), pulse((p.x + 0.37 * p.y) / 0.16, 0.5, footprint / 0.15));
    let rug = mix(border, field, step(rim - 0.11, footprint));
    let rug = shaded(rug, 0.35 * fractal_noise(seed ^ 2, at, 0.12, 3, footprint));
    mix(boards, rug, step(rim, footprint))
}

/// A painted wall over a panelled dado, with posters.
fn back_wall(seed: u64, at: DVec3, footprint: f64) -> DVec3 {
    let (x, y) = (at.x, at.y);
    let flecks = step(fractal_noise(seed ^ 5, at, 0.09, 2, footprint) - 0.55, 0.3);
    let plaster = mix(mottled(seed, at, footprint, hex(0x86A597), 0.3), hex(0xD9E2CF), 0.5 * flecks);
    let panel = (x / 0.24).floor();
    let tone = mix(hex(0xA0673A), hex(0xC99A62), dice(seed, panel, 7.0));
    let panels = wood(seed ^ 3, DVec3::new(y, x, panel), footprint, tone);
    let panels = panels * (1.0 - 0.7 * interval(x - (x / 0.24).round() * 0.24, 0.014, footprint));
    let rail = interval(y + 0.85, 0.035, footprint);
    let mut wall = mix(panels, plaster, step(-0.85 - y, footprint));
    wall = mix(wall, hex(0xF0E5CE), rail);
    for (index, (cx, cy, half_x, half_y, ground, ink)) in POSTERS.into_iter().enumerate() {
        let p = DVec2::new(x - cx, y - cy);
        let inside = step((half_x - p.x.abs()).min(half_y - p.y.abs()), footprint);
        if inside > 0.0 {
            wall = mix(
                wall,
                poster(seed ^ (index as u64 + 11), p, half_x, half_y, hex(ground), hex(ink), footprint),
                inside,
            );
        }
    }
    wall
}

/// Posters on the back wall: centre, half sizes (metres), ground and ink.
const POSTERS: [(f64, f64, f64, f64, u32, u32); 4] = [
    (-1.42, -1.62, 0.26, 0.40, 0xF4E9CF, 0xB0301F),
    (-0.1, -1.62, 0.42, 0.36, 0xF7C548, 0x1D2B4F),
    (0.72, -1.35, 0.2, 0.26, 0xEFEFEA, 0x1B6A70),
    (1.42, -1.6, 0.28, 0.4, 0x31406B, 0xF3D9A4),
];

fn poster(seed: u64, p: DVec2, half_x: f64, half_y: f64, ground: DVec3, ink: DVec3, footprint: f64) -> DVec3 {
    let rim = (half_x - p.x.abs()).min(half_y - p.y.abs());
    let frame = 1.0 - step(rim - 0.025, footprint);
    // A picture above, lines of writing below.
    let picture = fractal_noise(seed, p.extend(0.0), 0.22, 4, footprint);
    let shapes = step(picture - 0.05, footprint.max(0.06)) - 0.6 * step(picture - 0.5, footprint.max(0.06));
    let letter = 0.088;
    let writing = glyphs(seed ^ 1, p / letter, footprint / letter);
    let share = if p.y < half_y * 0.1 { shapes } else { writing * step(rim - 0.05, footprint) };
    mix(mix(ground, ink, share), hex(0x3B2A1C), frame)
}

fn bricks(seed: u64, at: DVec3, footprint: f64) -> DVec3 {
    let (length, height) = (0.3, 0.13);
    let row = (at.y / height).floor();
    let along = at.x / length + 0.5 * row.rem_euclid(2.0);
    let tone = dice(seed, along.floor(), row);
    let brick = if tone > 0.86 { hex(0x5D3A33) } else { mix(hex(0x9C4A32), hex(0xD08A5E), tone) };
    let brick = shaded(brick, 0.3 * fractal_noise(seed, at, 0.07, 3, footprint));
    let joint = interval((along - along.round()) * length, 0.011, footprint).max(interval(
        at.y - (at.y / height).round() * height,
        0.011,
        footprint,
    ));
    mix(brick, hex(0xD8CDBA), joint)
}

/// Striped wallpaper with a framed map.
fn wallpaper(seed: u64, at: DVec3, footprint: f64) -> DVec3 {
    let stripes = pulse(at.x / 0.32, 0.5, footprint / 0.32);
    let paper = mix(hex(0xE8D8B5), hex(0xC9876B), 0.75 * stripes);
    let cell = DVec2::new(at.x / 0.16, at.y / 0.2);
    let dot = cell - cell.round();
    let dots = step(0.055 - (dot * DVec2::new(0.16, 0.2)).length(), footprint);
    let ink = mix(hex(0x6E3B4E), hex(0x35637A), f64::from(dice(seed, cell.round().x, cell.round().y) > 0.5));
    let paper = shaded(mix(paper, ink, dots), 0.2 * fractal_noise(seed, at, 0.25, 3, footprint));
    let p = DVec2::new(at.x - 0.55, at.y + 1.45);
    let rim = (0.55 - p.x.abs()).min(0.42 - p.y.abs());
    let relief = fractal_noise(seed ^ 4, at, 0.35, 5, footprint);
    let land = mix(hex(0x7DA35A), hex(0xE7D6A0), step(relief - 0.45, footprint.max(0.1)));
    let map = mix(hex(0x3F7FA6), land, step(relief - 0.05, footprint.max(0.05)));
    let map = mix(hex(0x4A321F), map, step(rim - 0.035, footprint));
    mix(paper, map, step(rim, footprint))
}

fn crate_planks(seed: u64, at: DVec3, footprint: f64) -> DVec3 {
    let row = (at.y / 0.12).floor();
    let tone = mix(hex(0xB98246), hex(0xE0B878), dice(seed, row, at.z));
    let planks = wood(seed, DVec3::new(at.x, at.y, at.z + row), footprint, tone);
    let planks = planks * (1.0 - 0.75 * interval(at.y - (at.y / 0.12).round() * 0.12, 0.01, footprint));
    let letter = 0.11;
    let stamp = glyphs(seed ^ at.z as u64, DVec2::new(at.x, at.y - 0.03) / letter, footprint / letter)
        * step(0.17 - at.y.abs(), footprint)
        * step(0.23 - at.x.abs(), footprint);
    mix(planks, hex(0x3A2416), 0.85 * stamp)
}

fn books(seed: u64, at: DVec3, footprint: f64) -> DVec3 {
    const SPINES: [u32; 6] = [0xA63A2B, 0x2E5E74, 0xE2B34C, 0x4F6B3A, 0xE9DFC8, 0x5B3560];
    let shelf = (at.y / 0.3).floor();
    let x = at.x / 0.062 + 0.35 * shelf;
    let book = x.floor();
    let spine = hex(SPINES[(dice(seed, book, shelf + 40.0 * at.z) * 6.0) as usize % 6]);
    let label = hex(0xF5E8C4);
    let y = at.y - shelf * 0.3;
    let band = 0.12 + 0.1 * dice(seed ^ 1, book, shelf);
    let spine = mix(spine, label, 0.85 * interval(y - band, 0.022, footprint));
    let gap = interval((x - x.round()) * 0.062, 0.005, footprint);
    let board = 1.0 - step(0.3 - y - 0.025, footprint).min(step(y - 0.02, footprint));
    let spine = shaded(spine, 0.2 * fractal_noise(seed, at, 0.08, 2, footprint));
    mix(spine * (1.0 - 0.7 * gap), hex(0x7A5230), board)
}

fn drum(seed: u64, at: DVec3, footprint: f64) -> DVec3 {
    let zigzag = 0.06 * ((at.x / 0.12) - (at.x / 0.12).round()).abs();
    let bands = pulse((at.y + zigzag) / 0.14, 0.5, footprint / 0.14);
    let colour = mix(hex(0xF0E0BC), hex(0x2F6F62), bands);
    let top = mix(hex(0xEFE3CC), hex(0xC0582F), step(0.07 - (at.truncate().length() - 0.1).abs(), footprint));
    let colour = if at.z > 0.5 { top } else { colour };
    shaded(colour, 0.25 * fractal_noise(seed, at, 0.08, 3, footprint))
}

fn globe(seed: u64, at: DVec3, footprint: f64) -> DVec3 {
    let relief = fractal_noise(seed, at, 0.9, 4, footprint);
    let land = mix(hex(0x5E8F4B), hex(0xE3CB8F), step(relief - 0.5, footprint.max(0.15)));
    mix(hex(0x2B6CA3), land, step(relief - 0.02, footprint.max(0.08)))
}

/// A ball painted in octants with a belt, so that its spin shows.
fn octants(seed: u64, at: DVec3, footprint: f64, pair: [DVec3; 2], belt: DVec3) -> DVec3 {
    let side = |x: f64| 2.0 * step(x, footprint) - 1.0;
    let parity = 0.5 + 0.5 * side(at.x) * side(at.y) * side(at.z);
    let colour = mix(pair[0], pair[1], parity);
    let colour = mix(colour, belt, interval(at.y - 0.06, 0.13, footprint));
    let spots = step(0.28 - (at - DVec3::new(0.6, 0.62, 0.5).normalize()).length(), footprint)
        .max(step(0.24 - (at - DVec3::new(-0.7, -0.6, 0.4).normalize()).length(), footprint));
    let colour = mix(colour, hex(0x2A1C14), spots);
    shaded(colour, 0.2 * fractal_noise(seed, at, 0.4, 1, footprint))
}

/// Ground, patches and spots.
const LOOKS: [[u32; 3]; 11] = [
    [0xE2571E, 0xF6E7C8, 0x27418C],
    [0x1F8A8C, 0xF3D36B, 0x5A2340],
    [0xF2B632, 0x8C2F5B, 0xF7F1E1],
    [0x2F7D3A, 0xEDE6D6, 0xD8432B],
    [0x3A5BBF, 0xF7D9A0, 0x22253A],
    [0xD94F70, 0xFBF3E4, 0x2A6E6B],
    [0xF0F0E8, 0x30343F, 0xE2571E],
    [0x6B3FA0, 0xBFE3C0, 0xF2B632],
    [0x1A2036, 0x3A4A78, 0x6B2A2A],
    [0x2A1616, 0x6A2A22, 0x2E4A3A],
    [0x14261E, 0x2C5A44, 0x5A4A1E],
];

/// Patches and spots of noise throughout the body, so that every side differs from every other.
fn motley(seed: u64, at: DVec3, footprint: f64, look: [u32; 3], cell: f64) -> DVec3 {
    // How much the noise changes over a footprint.
    let blur = (2.0 * footprint / cell).max(0.12);
    let patches = step(fractal_noise(seed, at, cell, 2, footprint) - 0.02, blur);
    let spots = step(fractal_noise(seed ^ 9, at, 0.8 * cell, 1, footprint) - 0.42, blur);
    let colour = mix(mix(hex(look[0]), hex(look[1]), patches), hex(look[2]), spots);
    shaded(colour, 0.2 * fractal_noise(seed ^ 5, at, 0.5 * cell, 2, footprint))
}

/// A blade: `at` is (distance from the axis, distance across, 0), metres.
fn blade(seed: u64, at: DVec3, footprint: f64, number: u8) -> DVec3 {
    const COLOURS: [u32; 4] = [0xD8432B, 0xF2B632, 0x2A8C86, 0xEDE6D6];
    let colour = hex(COLOURS[usize::from(number) % COLOURS.len()]);
    let mark = if number % 4 == 3 { hex(0x33406E) } else { hex(0xF7F1E1) };
    let stripes = interval(at.x - 0.31, 0.022, footprint);
    let dot = step(0.03 - DVec2::new(at.x - 0.2, at.y).length(), footprint);
    shaded(mix(colour, mark, stripes.max(dot)), 0.15 * fractal_noise(seed, at, 0.07, 2, footprint))
}
