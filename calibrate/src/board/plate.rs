//! What is waved: a plate with a target on it, or with one on each side.

use std::{collections::HashSet, fmt};

use erfgs_scene::ImageRgb8;
use glam::DVec3;

use super::{BoardView, Corner, EventBoard, Target, detect};

/// A stiff plate with a target on its front and, where it has two sides, another one on its back. Corners of the back are
/// numbered after those of the front. A clear plate shows the target of its front from behind, too, as its mirror image.
#[derive(Clone, Debug, PartialEq)]
pub struct Plate {
    front: Target,
    back: Option<Target>,
    clear: bool,
}

/// A side of a plate.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Face {
    /// The one that `--target` names.
    Front,
    /// The one that `--back` names.
    Back,
}

/// Targets that cannot be on the two sides of one plate.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum PlateError {
    /// A chessboard is one of them.
    #[error(
        "{target} has no markers, so that nothing tells the one side of the board from the other; a board with two sides needs a \
         ChArUco board or an AprilGrid on each of them"
    )]
    NoMarkers {
        /// The chessboard.
        target: String,
    },
    /// A chessboard that is seen through.
    #[error(
        "{target} has no markers, so that nothing tells whether it is seen from behind; a clear board needs a ChArUco board or an \
         AprilGrid"
    )]
    ClearChessboard {
        /// The chessboard.
        target: String,
    },
    /// Markers of the one are markers of the other.
    #[error(
        "{count} markers of {back} are on {front}, too, so that the sides cannot be told apart; {}",
        instead.as_ref().map_or_else(
            || "print one of them with another dictionary, or with the numbers that the other leaves (first=NUMBER)".to_owned(),
            |instead| format!("print the other side as {instead}")
        )
    )]
    SameMarkers {
        /// The target of the front.
        front: String,
        /// That of the back.
        back: String,
        /// How many markers of the back there are on the front.
        count: usize,
        /// A back like this one with other markers, if there are enough of them.
        instead: Option<String>,
    },
}

impl Plate {
    /// A plate with a target on each side.
    ///
    /// # Errors
    /// If a picture would not tell which side it shows.
    pub fn two_sided(front: Target, back: Target) -> Result<Self, PlateError> {
        if let Some(plain) = [&front, &back].into_iter().find(|target| target.numbers().is_empty()) {
            return Err(PlateError::NoMarkers { target: plain.to_string() });
        }
        let of_front = codes(&front);
        let known: HashSet<(usize, u64)> = of_front.iter().flat_map(|&(side, code)| turns(side, code)).collect();
        let count = codes(&back).iter().filter(|code| known.contains(code)).count();
        if count > 0 {
            let free = [front.numbers().end, 0].into_iter().filter_map(|first| back.numbered_from(first));
            let instead = free.filter(|other| codes(other).iter().all(|code| !known.contains(code)));
            let instead = instead.map(|other| other.to_string()).next();
            return Err(PlateError::SameMarkers { front: front.to_string(), back: back.to_string(), count, instead });
        }
        Ok(Self { front, back: Some(back), clear: false })
    }

    /// A clear plate with a target on one side, which is seen from both.
    ///
    /// # Errors
    /// If a picture would not tell from which side it was taken.
    pub fn clear(front: Target) -> Result<Self, PlateError> {
        if front.numbers().is_empty() {
            return Err(PlateError::ClearChessboard { target: front.to_string() });
        }
        Ok(Self { front, back: None, clear: true })
    }

    /// Whether it is seen from behind, too.
    #[must_use]
    pub fn is_clear(&self) -> bool {
        self.clear
    }

    /// What is on the front.
    #[must_use]
    pub fn front(&self) -> &Target {
        &self.front
    }

    /// What is on the back, where it has two sides.
    #[must_use]
    pub fn back(&self) -> Option<&Target> {
        self.back.as_ref()
    }

    /// What is on a side; of a plate with one side, what is on that.
    pub(super) fn target(&self, face: Face) -> &Target {
        match (face, &self.back) {
            (Face::Back, Some(back)) => back,
            _ => &self.front,
        }
    }

    /// Where corner `id` is: on which side, and at which point of that side's target, metres.
    #[must_use]
    pub fn point(&self, id: u32) -> Option<(Face, DVec3)> {
        if let Some(point) = self.front.point(id) {
            return Some((Face::Front, point));
        }
        let of_back = self.back.as_ref()?.point(id - self.on_front())?;
        Some((Face::Back, of_back))
    }

    /// The side that a view shows: the one of which it has more corners.
    pub(super) fn face(&self, view: &BoardView) -> Face {
        let front = view.corners.iter().filter(|corner| corner.id < self.on_front()).count();
        if 2 * front >= view.corners.len() { Face::Front } else { Face::Back }
    }

    /// The corners of the side that a view shows, and where they are on that side's target, metres.
    pub(super) fn points<'a>(&'a self, view: &'a BoardView) -> impl Iterator<Item = (&'a Corner, DVec3)> {
        let shown = self.face(view);
        view.corners.iter().filter_map(move |corner| {
            let (face, point) = self.point(corner.id)?;
            (face == shown).then_some((corner, point))
        })
    }

    /// The corners in a frame, of one side; none where the plate is not seen.
    #[must_use]
    pub fn detect(&self, image: &ImageRgb8) -> Vec<Corner> {
        let front = detect(image, &self.front);
        if self.clear && 2 * front.len() < self.on_front() as usize {
            let behind = from_behind(image, &self.front);
            return if behind.len() > front.len() { behind } else { front };
        }
        // A plate shows one side at a time, and what is found of the other is a mistake.
        let Some(back) = self.back.as_ref().filter(|_| 2 * front.len() < self.on_front() as usize) else {
            return front;
        };
        let mut of_back = detect(image, back);
        if of_back.len() <= front.len() {
            return front;
        }
        of_back.iter_mut().for_each(|corner| corner.id += self.on_front());
        of_back
    }

    /// Whether a frame that does not show the front shows its mirror image; `None` where nothing would tell, or where that has been
    /// looked at already.
    pub(super) fn is_mirrored_in(&self, image: &ImageRgb8) -> Option<bool> {
        let can_tell = !self.clear && !self.front.numbers().is_empty();
        can_tell.then(|| from_behind(image, &self.front).len() >= ENOUGH)
    }

    /// The plate as it looks in the pictures that a stream of events gives.
    pub(super) fn as_seen(&self, events: EventBoard) -> Self {
        Self {
            front: events.as_seen(&self.front),
            back: self.back.as_ref().map(|back| events.as_seen(back)),
            clear: self.clear,
        }
    }

    /// Number of corners on the front.
    fn on_front(&self) -> u32 {
        let (columns, rows) = self.front.corners();
        columns * rows
    }
}

impl From<&Target> for Plate {
    fn from(front: &Target) -> Self {
        Self { front: front.clone(), back: None, clear: false }
    }
}

impl From<&Self> for Plate {
    fn from(plate: &Self) -> Self {
        plate.clone()
    }
}

impl fmt::Display for Plate {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.back {
            Some(back) => write!(f, "{} with {back} on its back", self.front),
            None if self.clear => write!(f, "{}, clear", self.front),
            None => write!(f, "{}", self.front),
        }
    }
}

/// So many corners are no mistake.
const ENOUGH: usize = 6;

/// The corners of a target that is seen through its plate, from behind: those of the mirror image, where they are in the image.
fn from_behind(image: &ImageRgb8, target: &Target) -> Vec<Corner> {
    let mut mirror = image.clone();
    let width = image.width as usize;
    for row in mirror.data.chunks_exact_mut(3 * width.max(1)) {
        let (pixels, _) = row.as_chunks_mut::<3>();
        pixels.reverse();
    }
    let mut corners = detect(&mirror, target);
    corners.iter_mut().for_each(|corner| corner.pixel.x = f64::from(image.width) - corner.pixel.x);
    corners
}

/// The codes of a target's markers: cells in a row, and one bit for each of them.
fn codes(target: &Target) -> Vec<(usize, u64)> {
    let Some(dictionary) = target.dictionary() else { return Vec::new() };
    let numbers = target.numbers();
    let own = dictionary.codes().get(numbers.start as usize..numbers.end as usize).unwrap_or_default();
    own.iter().map(|code| (dictionary.marker_size(), *code)).collect()
}

/// A code as it is read in each of four positions.
fn turns(side: usize, code: u64) -> impl Iterator<Item = (usize, u64)> {
    let turned = move |code: &u64| {
        let bit = |cell: usize| (code >> (side * (side - 1 - cell % side) + cell / side)) & 1;
        Some((0..side * side).fold(0, |turned, cell| turned | bit(cell) << cell))
    };
    std::iter::successors(Some(code), turned).take(4).map(move |code| (side, code))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn two(front: &str, back: &str) -> Result<Plate, PlateError> {
        Plate::two_sided(front.parse().unwrap(), back.parse().unwrap())
    }

    #[test]
    fn sides_that_look_alike_are_refused_with_what_to_print_in_place() {
        let refused = |front: &str, back: &str| two(front, back).unwrap_err().to_string();
        let grid = "aprilgrid:6x6:0.088:0.3";
        for (front, back) in [("chessboard:9x6:0.025", grid), (grid, "chessboard:9x6:0.025")] {
            let message = refused(front, back);
            assert!(message.contains("chessboard:9x6:0.025 has no markers"), "{message}");
        }
        let message = refused(grid, "aprilgrid:4x4:0.1:0.3:first=30");
        assert!(message.contains("6 markers of") && message.contains("aprilgrid:4x4:0.1:0.3:first=36"), "{message}");
        // The shorter dictionaries of a size are the beginning of the longer ones.
        let message = refused("charuco:5x4:0.05:0.04:DICT_4X4_50", "charuco:5x4:0.05:0.04:DICT_4X4_100");
        assert!(message.contains("10 markers of") && message.contains("DICT_4X4_100:first=10"), "{message}");
        // What is left begins at 0.
        let message =
            refused("charuco:8x6:0.05:0.04:DICT_4X4_50:first=26", "charuco:8x6:0.05:0.04:DICT_4X4_50:first=20");
        assert!(message.ends_with("charuco:8x6:0.05:0.04:DICT_4X4_50"), "{message}");
        let message = refused("charuco:8x8:0.05:0.04:DICT_4X4_50", "charuco:8x8:0.05:0.04:DICT_4X4_50");
        assert!(message.contains("another dictionary"), "{message}");
        // AprilTags are the same in a ChArUco board, on their heads.
        let message = refused(grid, "charuco:5x4:0.05:0.04:DICT_APRILTAG_36h11");
        assert!(message.contains("10 markers of"), "{message}");
    }

    #[test]
    fn corners_of_the_back_count_after_those_of_the_front() {
        let plate = two("aprilgrid:2x2:0.1:0.5", "charuco:5x4:0.05:0.04:DICT_4X4_50").unwrap();
        assert_eq!(plate.point(15), Some((Face::Front, plate.front().point(15).unwrap())));
        assert_eq!(plate.point(16), Some((Face::Back, DVec3::new(0.05, 0.05, 0.0))));
        assert_eq!((plate.point(27).map(|(face, _)| face), plate.point(28)), (Some(Face::Back), None));
        let view = |ids: &[u32]| BoardView {
            instant: String::new(),
            time_s: None,
            file: "drawn".into(),
            frame: 0,
            corners: ids.iter().map(|&id| Corner { id, pixel: glam::DVec2::ZERO }).collect(),
        };
        let (front, back) = (view(&[1, 2, 17]), view(&[1, 17, 18, 99]));
        assert_eq!([plate.face(&front), plate.face(&back)], [Face::Front, Face::Back]);
        assert_eq!(plate.points(&back).map(|(corner, _)| corner.id).collect::<Vec<_>>(), [17, 18]);
    }
}
