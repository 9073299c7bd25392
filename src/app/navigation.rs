//! Navigation: input moves the camera. Pure: no window, no device, f64 throughout.
//!
//! Input applies to the point under the cursor. A drag turns the camera about it, or moves it with
//! the cursor; the wheel removes a share of the distance to it, so the camera can come arbitrarily
//! near and never passes through. There are no near and far planes to set.
//!
//! - orbit: a drag turns about the point, as on a turntable; the picture never rolls.
//! - fly: a drag looks around, the wheel changes the speed.
//! - earth: a drag grabs the ground, which stays at its height.
//!
//! The keys W A S D, Q and E fly in all modes.

use super::viewport::Viewport;
use crate::select::clip::Clips;
use crate::view::{Basis, Camera, Covered, Preset, Projection, View};
use glam::{DQuat, DVec2, DVec3};
use std::f64::consts::{FRAC_PI_2, PI};
use std::sync::Arc;
use strum::{EnumString, IntoStaticStr, VariantArray};

/// Effect of a drag with the first button.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Mode {
    #[default]
    Orbit,
    Fly,
    Earth,
}

impl Mode {
    pub const ALL: [Mode; 3] = [Mode::Orbit, Mode::Fly, Mode::Earth];

    pub fn name(self) -> &'static str {
        match self {
            Mode::Orbit => "orbit",
            Mode::Fly => "fly",
            Mode::Earth => "earth",
        }
    }
}

/// Mouse buttons of other programs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[derive(EnumString, IntoStaticStr, VariantArray)]
#[strum(serialize_all = "kebab-case")]
pub enum NavigationStyle {
    /// Left turns, right and middle move
    #[default]
    Potree,
    /// Left turns, right moves, middle too
    Cloudcompare,
    /// Middle turns, with shift it moves, with control it zooms; left picks
    Blender,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Button {
    Left,
    Middle,
    Right,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Modifiers {
    pub shift: bool,
    pub control: bool,
}

/// Directions of flight.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Direction {
    Forward,
    Back,
    Left,
    Right,
    Up,
    Down,
}

/// Input that moves the camera. Positions are in pixels from the window's top left; `under` is the
/// place of the surface there (world), if any.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Input {
    Press {
        button: Button,
        modifiers: Modifiers,
        at: DVec2,
        under: Option<DVec3>,
    },
    Release {
        button: Button,
    },
    Move {
        to: DVec2,
    },
    /// Zooms; positive notches go nearer.
    Wheel {
        notches: f64,
        at: DVec2,
        under: Option<DVec3>,
    },
    /// Moves a point to the middle of the picture.
    Centre {
        on: DVec3,
    },
    Fly {
        direction: Direction,
        pressed: bool,
    },
    /// Frames the subject, beside what covers the picture.
    Look {
        from: Preset,
    },
    Project {
        onto: Projection,
    },
    OtherProjection,
    NextMode,
    /// Sets the mode of drags.
    Drag {
        mode: Mode,
    },
}

impl Input {
    /// Returns whether it chooses a view that applies to any subject.
    pub fn is_a_view(&self) -> bool {
        matches!(self, Input::Look { .. } | Input::Project { .. } | Input::OtherProjection)
    }
}

/// The subject of the camera.
#[derive(Clone, Debug, Default)]
pub struct Subject {
    /// Points that a camera should frame (world).
    pub core: Arc<Vec<DVec3>>,
    /// Their corners (world).
    pub bounds: (DVec3, DVec3),
    pub centre: DVec3,
    /// Half of the diagonal `[m]`.
    pub radius: f64,
    /// The vertical axis.
    pub up: DVec3,
}

impl Subject {
    pub fn of(core: Vec<DVec3>, up: DVec3) -> Subject {
        let bounds @ (min, max) =
            core.iter().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(min, max), &p| {
                (min.min(p), max.max(p))
            });
        let (centre, radius) = if core.is_empty() {
            (DVec3::ZERO, 1.0)
        } else {
            ((min + max) / 2.0, ((max - min) / 2.0).length())
        };
        let radius = if radius > 0.0 { radius } else { 1.0 };
        Subject { core: Arc::new(core), bounds, centre, radius, up }
    }
}

/// The effect of a drag in progress on a point.
#[derive(Clone, Copy, Debug, PartialEq)]
enum DragAction {
    /// Turns about the point.
    Turn(DVec3),
    /// Keeps the point under the cursor, in a plane that faces the camera.
    Move(DVec3),
    /// Keeps the point under the cursor, at its height.
    Grab(DVec3),
    /// Looks around.
    Look,
    Zoom(DVec3),
}

#[derive(Clone, Copy, Debug)]
struct Drag {
    button: Button,
    action: DragAction,
    last: DVec2,
}

/// Share of the distance that a notch of the wheel leaves.
const NOTCH: f64 = 0.8;

/// Farthest that the mouse moves while its wheel turns `[px]`.
const STAYS_PX: f64 = 8.0;

/// Least and largest distances that the wheel reaches, in radii of the subject.
const NEAREST: f64 = 1e-6;
const FARTHEST: f64 = 1e6;

/// Initial speed of flight, in radii of the subject a second: a fifth of its diagonal.
const SPEED: f64 = 0.4;

/// Slowest and fastest flight, in radii of the subject a second.
const SPEEDS: [f64; 2] = [1e-5, 1e2];

/// Least slope at which the ground is grabbed: at a grazing view it would run away.
const GRAZING: f64 = 0.05;

/// The camera, and the state of its navigation.
pub struct Navigation {
    pub camera: Camera,
    pub mode: Mode,
    pub style: NavigationStyle,
    /// Speed of flight [m/s].
    pub speed: f64,
    subject: Subject,
    /// Boxes that leave the points to frame.
    pub clips: Clips,
    viewport: Viewport,
    /// Covered edges of the free part of the viewport.
    pub covered: Covered,
    /// The view that was framed, and its camera, until the camera moves.
    framed: Option<(Preset, Camera)>,
    drag: Option<Drag>,
    held: Vec<Direction>,
    /// Where the cursor was at the wheel's first notch, the point that it goes towards, and the
    /// camera after its last notch.
    wheeled: Option<(DVec2, DVec3, Camera)>,
}

impl Navigation {
    pub fn new(style: NavigationStyle, size: [u32; 2]) -> Navigation {
        let subject = Subject::of(Vec::new(), DVec3::Z);
        let camera = Camera::framing(Preset::Fit, &[], size);
        let viewport = Viewport::new(size, 0.0);
        Navigation {
            camera,
            mode: Mode::default(),
            style,
            speed: SPEED * subject.radius,
            subject,
            clips: Clips::default(),
            viewport,
            covered: Covered::default(),
            framed: None,
            drag: None,
            held: Vec::new(),
            wheeled: None,
        }
    }

    /// Sets the subject. The camera stays, and the speed scales with the subject's size.
    pub fn set_subject(&mut self, subject: Subject) {
        self.speed *= subject.radius / self.subject.radius;
        self.subject = subject;
    }

    pub fn set_viewport(&mut self, viewport: Viewport) {
        self.viewport = viewport;
    }

    /// Returns the view that was framed last, unless the camera has moved since.
    pub fn framed(&self) -> Option<Preset> {
        self.framed.filter(|(_, camera)| *camera == self.camera).map(|(from, _)| from)
    }

    pub fn is_flying(&self) -> bool {
        !self.held.is_empty()
    }

    pub fn is_dragging(&self) -> bool {
        self.drag.is_some()
    }

    /// Releases all keys and buttons, as when the window loses its focus.
    pub fn release_all(&mut self) {
        self.drag = None;
        self.held.clear();
    }

    /// Applies input to the camera.
    pub fn handle(&mut self, input: Input) {
        let (framed, before) = (self.framed(), self.camera);
        if !matches!(input, Input::Wheel { .. } | Input::Move { .. } | Input::Release { .. }) {
            self.wheeled = None;
        }
        match input {
            Input::Press { button, modifiers, at, under } => {
                let point = self.point(at, under);
                self.focus(point);
                let action = self.drag_action(button, modifiers, point);
                self.drag = action.map(|action| Drag { button, action, last: at });
            }
            Input::Release { button } => self.drag = self.drag.filter(|drag| drag.button != button),
            Input::Move { to } => self.dragged(to),
            Input::Wheel { notches, .. } if self.mode == Mode::Fly => {
                let [slowest, fastest] = SPEEDS.map(|speed| speed * self.subject.radius);
                self.speed = (self.speed * NOTCH.powf(-notches)).clamp(slowest, fastest);
            }
            Input::Wheel { notches, at, under } => {
                let point = self.towards(at, under);
                self.zoom(point, NOTCH.powf(notches));
                self.keep_in_front();
                self.wheeled = self.wheeled.map(|(from, point, _)| (from, point, self.camera));
            }
            Input::Centre { on } => {
                self.shift(on - self.camera.eye - self.basis().forward * self.depth(on))
            }
            Input::Fly { direction, pressed } => {
                self.held.retain(|&held| held != direction);
                if pressed {
                    self.held.push(direction);
                }
            }
            Input::Look { from } => {
                let Subject { core, bounds, up, .. } = &self.subject;
                // Points that clip boxes leave. Small boxes have none of these samples and are
                // framed themselves; all points are, if boxes lie beside them.
                let mut kept: Vec<DVec3> =
                    core.iter().copied().filter(|&p| self.clips.keep(p)).collect();
                if kept.is_empty() {
                    kept = self.clips.corners(*bounds);
                }
                let framed = if kept.is_empty() { &**core } else { &kept };
                self.camera =
                    Camera::framing_beside(from, framed, self.viewport.free(), self.covered, *up);
            }
            Input::Project { onto } => self.project(onto),
            Input::OtherProjection => self.project(match self.camera.projection {
                Projection::Perspective => Projection::Orthographic,
                Projection::Orthographic => Projection::Perspective,
            }),
            Input::Drag { mode } => self.mode = mode,
            Input::NextMode => {
                let at =
                    Mode::ALL.iter().position(|&mode| mode == self.mode).expect("all are there");
                self.mode = Mode::ALL[(at + 1) % Mode::ALL.len()];
            }
        }
        self.keep_in_front();
        self.framed = match input {
            Input::Look { from } => Some((from, self.camera)),
            // It only chooses what the camera turns about.
            Input::Press { .. } => framed.map(|from| (from, self.camera)),
            _ => framed.filter(|_| self.camera == before).map(|from| (from, before)),
        };
    }

    /// Moves the camera along the held keys.
    pub fn advance(&mut self, seconds: f64) {
        let Basis { right, forward, .. } = self.basis();
        let along = |direction: &Direction| match direction {
            Direction::Forward => forward,
            Direction::Back => -forward,
            Direction::Right => right,
            Direction::Left => -right,
            Direction::Up => self.subject.up,
            Direction::Down => -self.subject.up,
        };
        let direction: DVec3 = self.held.iter().map(along).sum();
        let step = direction.normalize_or_zero() * self.speed * seconds;
        if self.camera.projection == Projection::Orthographic {
            // Without perspective nothing comes nearer; the picture shows less instead.
            let height = self.camera.ortho_height.unwrap_or(1.0);
            let height = height * (-step.dot(forward) / self.subject.radius).exp();
            self.camera.ortho_height =
                Some(height.clamp(self.nearest(), FARTHEST * self.subject.radius));
        }
        self.shift(step);
        self.keep_in_front();
    }

    fn drag_action(
        &self,
        button: Button,
        modifiers: Modifiers,
        point: DVec3,
    ) -> Option<DragAction> {
        if self.style == NavigationStyle::Blender {
            return match (button, modifiers) {
                (Button::Middle, Modifiers { shift: true, .. }) => Some(DragAction::Move(point)),
                (Button::Middle, Modifiers { control: true, .. }) => Some(DragAction::Zoom(point)),
                (Button::Middle, _) => Some(self.turning(point)),
                _ => None,
            };
        }
        match (button, modifiers.shift) {
            (Button::Left, false) => Some(self.turning(point)),
            (Button::Right, false) if self.mode == Mode::Earth => Some(DragAction::Turn(point)),
            _ => Some(DragAction::Move(point)),
        }
    }

    fn turning(&self, point: DVec3) -> DragAction {
        match self.mode {
            Mode::Orbit => DragAction::Turn(point),
            Mode::Fly => DragAction::Look,
            Mode::Earth => DragAction::Grab(point),
        }
    }

    fn dragged(&mut self, to: DVec2) {
        let Some(drag) = self.drag else { return };
        let by = to - drag.last;
        self.drag = Some(Drag { last: to, ..drag });
        let across = by / self.viewport.size()[1] as f64;
        match drag.action {
            DragAction::Turn(about) => self.turn(about, -across.x * PI, -across.y * PI),
            DragAction::Look => {
                let angle = self.camera.fov_y.to_radians();
                self.turn(self.camera.eye, across.x * angle, across.y * angle);
            }
            DragAction::Move(point) => self.bring_under(point, to),
            DragAction::Grab(point) => self.grab(point, to),
            DragAction::Zoom(point) => self.zoom(point, (4.0 * across.y).exp()),
        }
    }

    /// Returns the point that input applies to: the one under the cursor, or else one as deep as
    /// the camera's target.
    fn point(&self, at: DVec2, under: Option<DVec3>) -> DVec3 {
        under.filter(|&point| self.depth(point) > 0.0).unwrap_or_else(|| {
            let (origin, direction) = self.view().ray(at.x, at.y);
            origin + direction * self.depth(self.camera.target)
        })
    }

    /// Returns the point that the wheel goes towards. It stays that of the first notch while the
    /// cursor stays, unless a nearer one appears: from near by, points behind a surface are visible
    /// through its gaps, and would lead through it.
    fn towards(&mut self, at: DVec2, under: Option<DVec3>) -> DVec3 {
        let point = self.point(at, under);
        let stays = |(from, _, camera): &(DVec2, DVec3, Camera)| {
            from.distance(at) < STAYS_PX && *camera == self.camera
        };
        let is_nearer = |(_, kept, _): &(DVec2, DVec3, Camera)| {
            (0.0..=self.depth(point)).contains(&self.depth(*kept))
        };
        let kept = self.wheeled.filter(|kept| stays(kept) && is_nearer(kept));
        let (from, point, camera) = kept.unwrap_or((at, point, self.camera));
        self.wheeled = Some((from, point, camera));
        point
    }

    fn view(&self) -> View {
        self.viewport.view(self.camera).expect("navigation keeps the camera valid")
    }

    fn basis(&self) -> Basis {
        self.camera.basis().expect("navigation keeps the camera valid")
    }

    fn depth(&self, point: DVec3) -> f64 {
        (point - self.camera.eye).dot(self.basis().forward)
    }

    /// Returns the least distance to a point `[m]`, no less than coordinates resolve.
    fn nearest(&self) -> f64 {
        (NEAREST * self.subject.radius).max(1e-12 * self.subject.centre.length())
    }

    /// Moves the target to the depth of a point.
    fn focus(&mut self, point: DVec3) {
        let depth = self.depth(point).max(self.nearest());
        self.camera.target = self.camera.eye + self.basis().forward * depth;
    }

    fn shift(&mut self, by: DVec3) {
        self.camera.eye += by;
        self.camera.target += by;
    }

    /// Turns about the world's vertical and the picture's horizontal, which stays horizontal; never
    /// over the top.
    fn turn(&mut self, about: DVec3, around: f64, over: f64) {
        let Basis { right, up, forward } = self.basis();
        // Sine and cosine together, since the sine alone is imprecise near the top.
        let vertical = self.subject.up;
        let elevation = forward.dot(vertical).atan2(up.dot(vertical));
        let over = (elevation + over).clamp(-FRAC_PI_2, FRAC_PI_2) - elevation;
        let turn = DQuat::from_axis_angle(vertical, around) * DQuat::from_axis_angle(right, over);
        self.camera.eye = about + turn * (self.camera.eye - about);
        self.camera.target = about + turn * (self.camera.target - about);
        self.camera.up = (turn * up).normalize();
    }

    /// Moves the camera so that a point lies under the cursor.
    fn bring_under(&mut self, point: DVec3, to: DVec2) {
        let (origin, direction) = self.view().ray(to.x, to.y);
        self.shift(point - (origin + direction * self.depth(point)));
    }

    /// Moves the camera horizontally so that a point lies under the cursor; at grazing views as
    /// [`Self::bring_under`].
    fn grab(&mut self, point: DVec3, to: DVec2) {
        let (origin, direction) = self.view().ray(to.x, to.y);
        let (way, descent) = (point - origin, direction.dot(self.subject.up));
        let along = way.dot(self.subject.up) / descent;
        let grazing = descent.abs() < GRAZING * direction.length();
        if grazing || along <= 0.0 || !along.is_finite() {
            return self.bring_under(point, to);
        }
        self.shift(point - (origin + direction * along));
    }

    /// Zooms so that a share of the distance to a point remains; the point stays where it is on the
    /// screen.
    fn zoom(&mut self, point: DVec3, share: f64) {
        let away = match self.camera.projection {
            Projection::Perspective => self.depth(point),
            Projection::Orthographic => self.camera.ortho_height.unwrap_or(1.0),
        };
        if !(self.nearest()..FARTHEST * self.subject.radius).contains(&(away * share)) {
            return;
        }
        match self.camera.projection {
            Projection::Perspective => {
                self.camera.eye = point + (self.camera.eye - point) * share;
                self.camera.target = point + (self.camera.target - point) * share;
                self.focus(point);
            }
            Projection::Orthographic => {
                let aside = point - self.camera.eye - self.basis().forward * self.depth(point);
                self.shift(aside * (1.0 - share));
                self.camera.ortho_height = self.camera.ortho_height.map(|height| height * share);
            }
        }
    }

    /// Changes the projection; the target keeps its size on the screen.
    fn project(&mut self, onto: Projection) {
        if onto == self.camera.projection {
            return;
        }
        let slope = (self.camera.fov_y.to_radians() / 2.0).tan();
        let Camera { eye, target, .. } = self.camera;
        match onto {
            Projection::Orthographic => {
                self.camera.ortho_height = Some(2.0 * slope * (target - eye).length())
            }
            Projection::Perspective => {
                let distance = self.camera.ortho_height.unwrap_or(1.0) / (2.0 * slope);
                self.camera.eye = target - self.basis().forward * distance;
                self.camera.ortho_height = None;
            }
        }
        self.camera.projection = onto;
    }

    /// Moves an orthographic camera in front of the subject: its distance does not change the
    /// picture, but points behind it are not drawn.
    fn keep_in_front(&mut self) {
        if self.camera.projection == Projection::Orthographic {
            let forward = self.basis().forward;
            let depth = self.depth(self.subject.centre);
            self.camera.eye += forward * (depth - 2.0 * self.subject.radius);
            // The target keeps its place on the screen, and gets the subject's depth.
            self.camera.target = self.camera.eye + forward * 2.0 * self.subject.radius;
        }
    }
}
