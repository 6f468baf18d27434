//! What moves: bodies, and the parts that they are made of.

use super::{
    form::Form,
    motion::{Ball, Fan, Pendulum},
    paint::Paint,
    path::Path,
};

/// A shape with a path and a look.
#[derive(Clone, Debug)]
pub(crate) struct Part {
    /// Which body it belongs to.
    pub body: usize,
    pub form: Form,
    pub path: Path,
    pub paint: Paint,
    /// The radius of the ball that casts its shadow, metres; what has none casts none.
    pub shade: Option<f64>,
    /// How much of the lamp it mirrors: 0 for dull paint.
    pub gloss: f64,
    /// Spheres in its frame that hold it.
    pub spheres: Vec<(glam::DVec3, f64)>,
}

impl Part {
    pub(crate) fn new(form: Form, path: Path, paint: Paint) -> Self {
        let spheres = form.spheres();
        Self { body: 0, form, path, paint, shade: None, gloss: 0.0, spheres }
    }

    pub(crate) fn shaded(self, radius: f64) -> Self {
        Self { shade: Some(radius), ..self }
    }
}

/// A thing that moves as one: rigid, unless its parts bend.
#[derive(Clone, Debug)]
pub(crate) struct Body {
    /// A name that no other has.
    pub name: String,
    /// Whether its shape stays as it is.
    pub rigid: bool,
    /// When it is first in view, seconds; what always is has minus infinity.
    pub appears: f64,
}

/// Everything that moves. A set of it is an [`super::actors::Actors`], a bit for each part.
#[derive(Clone, Debug, Default)]
pub(crate) struct Cast {
    pub bodies: Vec<Body>,
    pub parts: Vec<Part>,
}

impl Cast {
    /// The take without acts: a ball, a fan and a pendulum.
    pub(crate) fn ordinary() -> Self {
        let mut cast = Self::default();
        let (ball, fan) = (Ball::default(), Fan::default());
        let thrown = Part::new(Form::Ball { radius: ball.radius }, Path::Ball(ball.clone()), Paint::Ball);
        cast.add("ball", vec![thrown.shaded(ball.radius)]);
        cast.add("fan", blades(&fan));
        cast.add("pendulum", rod_and_bob(&Pendulum::default()));
        cast
    }

    /// Adds a rigid body. A name that is taken gets a number.
    pub(crate) fn add(&mut self, name: &str, parts: Vec<Part>) -> &mut Body {
        let taken = |name: &str| self.bodies.iter().any(|body| body.name == name);
        let mut free = name.to_owned();
        let mut number = 2;
        while taken(&free) {
            free = format!("{name}-{number}");
            number += 1;
        }
        let body = self.bodies.len();
        self.parts.extend(parts.into_iter().map(|part| Part { body, ..part }));
        self.bodies.push(Body { name: free, rigid: true, appears: f64::NEG_INFINITY });
        &mut self.bodies[body]
    }

    /// The parts of a body.
    pub(crate) fn parts_of(&self, body: usize) -> impl Iterator<Item = &Part> {
        self.parts.iter().filter(move |part| part.body == body)
    }
}

/// The blades of a fan, which turn as one.
pub(crate) fn blades(fan: &Fan) -> Vec<Part> {
    let form = Form::Blade { span: fan.blade_span, width: fan.blade_width };
    let blade = |number| Part::new(form.clone(), Path::Blade(fan.clone(), number), Paint::Blade(number as u8));
    (0..fan.count).map(blade).collect()
}

/// A pendulum's parts.
pub(crate) fn rod_and_bob(pendulum: &Pendulum) -> Vec<Part> {
    let rod = Form::Rod { length: pendulum.length, radius: pendulum.rod_radius };
    let bob = Form::Ball { radius: pendulum.bob_radius };
    vec![
        Part::new(rod, Path::Rod(pendulum.clone()), Paint::Rod),
        Part::new(bob, Path::Bob(pendulum.clone()), Paint::Bob).shaded(pendulum.bob_radius),
    ]
}
