//! Where an error can act. An effect is nothing but a rule that adds to some of these places.

use crate::pose::Direction;

/// Most rotary axes a machine may have.
pub const MAX_ROTARY: usize = 3;
/// Places of one rotary axis: its frame (three offsets, three tilts) and its own turn.
const PER_AXIS: usize = 7;
const PLACEMENT: usize = PER_AXIS * MAX_ROTARY;
const LINEAR: usize = PLACEMENT + 6;
const OFFSET: usize = LINEAR + 9;
const RADIUS: usize = OFFSET + 3;
const LENGTH: usize = RADIUS + 1;
/// Number of places.
pub const COUNT: usize = LENGTH + 4;

/// One of the six components of a small rigid displacement: offsets in mm, tilts in rad,
/// applied as translate(EX, EY, EZ) R(EA, EB, EC).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Component {
    /// Offset along a direction.
    Offset(Direction),
    /// Tilt about a direction.
    Tilt(Direction),
}

impl Component {
    /// The six components in order X, Y, Z, A, B, C.
    pub const ALL: [Self; 6] = [
        Self::Offset(Direction::X),
        Self::Offset(Direction::Y),
        Self::Offset(Direction::Z),
        Self::Tilt(Direction::X),
        Self::Tilt(Direction::Y),
        Self::Tilt(Direction::Z),
    ];

    /// 0 to 5.
    #[must_use]
    pub const fn index(self) -> usize {
        match self {
            Self::Offset(direction) => direction.index(),
            Self::Tilt(direction) => 3 + direction.index(),
        }
    }

    /// X, Y, Z, A, B or C, the second letter of an ISO 230-1 name.
    #[must_use]
    pub const fn letter(self) -> char {
        match self {
            Self::Offset(direction) => direction.travel_letter(),
            Self::Tilt(direction) => direction.turn_letter(),
        }
    }
}

/// A place: an index into [`Places`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Place(usize);

impl Place {
    /// How much the effective radius of the ball grows, mm.
    pub const RADIUS: Self = Self(RADIUS);
    /// How much longer the artefact is than nominal, mm (of a sphere: its diameter).
    pub const LENGTH: Self = Self(LENGTH);
    /// How much wider, mm.
    pub const WIDTH: Self = Self(LENGTH + 1);
    /// How much higher, mm; the base stays.
    pub const HEIGHT: Self = Self(LENGTH + 2);
    /// Turn of the cross's Y bar about +Z, rad.
    pub const SQUARENESS: Self = Self(LENGTH + 3);

    /// Frame of rotary axis number `axis`, before its own turn.
    #[must_use]
    pub const fn frame(axis: usize, component: Component) -> Self {
        Self(PER_AXIS * axis + component.index())
    }

    /// Own turn of rotary axis number `axis`, added to its position, rad.
    #[must_use]
    pub const fn turn(axis: usize) -> Self {
        Self(PER_AXIS * axis + 6)
    }

    /// Placement of the artefact on the table.
    #[must_use]
    pub const fn placement(component: Component) -> Self {
        Self(PLACEMENT + component.index())
    }

    /// Λ_ij of p_actual = (I + Λ) p_recorded + δ.
    #[must_use]
    pub const fn linear(row: Direction, column: Direction) -> Self {
        Self(LINEAR + 3 * row.index() + column.index())
    }

    /// δ_i of p_actual = (I + Λ) p_recorded + δ, mm.
    #[must_use]
    pub const fn offset(direction: Direction) -> Self {
        Self(OFFSET + direction.index())
    }

    /// Position in [`Places`].
    #[must_use]
    pub const fn index(self) -> usize {
        self.0
    }

    /// Whether the place belongs to the machine (axes, recorded position), not to artefact or
    /// probe: what acts here moves the tool on the work.
    #[must_use]
    pub const fn is_machine(self) -> bool {
        self.0 < PLACEMENT || (self.0 >= LINEAR && self.0 < RADIUS)
    }

    /// Whether the place belongs to the frame or turn of a rotary axis.
    #[must_use]
    pub const fn is_rotary(self) -> bool {
        self.0 < PLACEMENT
    }
}

/// The amount at every place, in mm and rad.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Places([f64; COUNT]);

impl Default for Places {
    fn default() -> Self {
        Self([0.0; COUNT])
    }
}

impl Places {
    /// Adds to one place.
    pub fn add(&mut self, place: Place, amount: f64) {
        self.0[place.0] += amount;
    }

    /// The amount at one place.
    #[must_use]
    pub const fn at(&self, place: Place) -> f64 {
        self.0[place.0]
    }

    /// The six components of the frame of a rotary axis.
    #[must_use]
    pub fn frame(&self, axis: usize) -> &[f64] {
        &self.0[PER_AXIS * axis..PER_AXIS * axis + 6]
    }

    /// The six components of the placement.
    #[must_use]
    pub fn placement(&self) -> &[f64] {
        &self.0[PLACEMENT..PLACEMENT + 6]
    }

    /// Λ, row by row.
    #[must_use]
    pub fn linear(&self) -> &[f64] {
        &self.0[LINEAR..LINEAR + 9]
    }

    /// δ.
    #[must_use]
    pub fn offset(&self) -> &[f64] {
        &self.0[OFFSET..OFFSET + 3]
    }

    /// What decides the pose of the table: frames and turns of the axes and the placement.
    #[must_use]
    pub fn pose_part(&self) -> &[f64] {
        &self.0[..LINEAR]
    }

    /// What decides the shape of the artefact.
    #[must_use]
    pub fn shape_part(&self) -> &[f64] {
        &self.0[LENGTH..]
    }

    /// All amounts.
    #[must_use]
    pub const fn all(&self) -> &[f64; COUNT] {
        &self.0
    }

    /// All amounts, to write.
    pub const fn all_mut(&mut self) -> &mut [f64; COUNT] {
        &mut self.0
    }
}
