//! The first crossing of a ray with a torus around the z axis, exact to the last digits of f64.
//!
//! The quartic is not solved by formula (Ferrari loses half of the digits near double roots, which
//! is every silhouette). The roots of its derivatives cut the ray into intervals on which the
//! polynomial is monotonic. Each interval with a change of sign holds one root, which bisection
//! finds whatever other roots are near. Newton on the signed distance, which is well scaled, then
//! polishes.

use glam::DVec3;

pub fn intersect(
    major: f64,
    minor: f64,
    origin: DVec3,
    direction: DVec3,
    t_min: f64,
    t_max: f64,
) -> Option<f64> {
    // Unit speed, and the parameter counted from the point nearest to the centre: coefficients stay
    // of the torus's own size.
    let speed = direction.length();
    let d = direction / speed;
    let middle = -origin.dot(d);
    let o = origin + d * middle;
    let reach = (major + minor) * (1.0 + 1e-12);
    let half2 = reach * reach - o.length_squared();
    if half2 <= 0.0 {
        return None;
    }
    let half = half2.sqrt();
    let (low, high) = ((t_min * speed - middle).max(-half), (t_max * speed - middle).min(half));
    if low >= high {
        return None;
    }
    // (|p|^2 + R^2 - r^2)^2 - 4 R^2 (x^2 + y^2), with p = o + t d and o.d = 0.
    let k = o.length_squared() + major * major - minor * minor;
    let four = 4.0 * major * major;
    let quartic = [
        k * k - four * (o.x * o.x + o.y * o.y),
        -four * 2.0 * (o.x * d.x + o.y * d.y),
        2.0 * k - four * (d.x * d.x + d.y * d.y),
        0.0,
        1.0,
    ];
    let mut crossings = [0.0; 4];
    let count = roots(&quartic, low, high, &mut crossings);
    let distance = |t: f64| {
        let p = o + d * t;
        (p.x.hypot(p.y) - major).hypot(p.z) - minor
    };
    crossings[..count].iter().find_map(|&root| {
        let mut t = root;
        for _ in 0..3 {
            let p = o + d * t;
            let radial = p.x.hypot(p.y);
            let ring = radial - major;
            let tube = ring.hypot(p.z);
            if tube == 0.0 || radial == 0.0 {
                break;
            }
            let slope = (ring * (p.x * d.x + p.y * d.y) / radial + p.z * d.z) / tube;
            let step = (tube - minor) / slope;
            // At a grazing touch the slope vanishes; the bracketed root is then better than a long
            // Newton step.
            if !step.is_finite()
                || step.abs() > 1e-6 * minor
                || distance(t - step).abs() > distance(t).abs()
            {
                break;
            }
            t -= step;
        }
        let parameter = (t + middle) / speed;
        (parameter > t_min && parameter < t_max).then_some(parameter)
    })
}

/// Returns where the polynomial (lowest power first, degree up to 4) changes sign in (low, high),
/// ascending, and the number of changes.
fn roots(polynomial: &[f64], low: f64, high: f64, found: &mut [f64; 4]) -> usize {
    let degree = polynomial.len() - 1;
    if degree == 1 {
        let root = -polynomial[0] / polynomial[1];
        found[0] = root;
        return (root > low && root < high) as usize;
    }
    let mut derivative = [0.0; 4];
    for (power, &c) in polynomial.iter().enumerate().skip(1) {
        derivative[power - 1] = c * power as f64;
    }
    let mut turns = [0.0; 4];
    let turn_count = roots(&derivative[..degree], low, high, &mut turns);
    let value = |t: f64| polynomial.iter().rev().fold(0.0, |sum, &c| sum * t + c);
    let mut count = 0;
    let mut from = (low, value(low));
    for at in turns[..turn_count].iter().copied().chain(std::iter::once(high)) {
        let to = (at, value(at));
        if (from.1 < 0.0) != (to.1 < 0.0) {
            found[count] = bisect(value, from, to);
            count += 1;
        }
        from = to;
    }
    count
}

/// Returns the root in a bracket by false position in its Illinois form, halved whenever it stalls.
fn bisect(value: impl Fn(f64) -> f64, from: (f64, f64), to: (f64, f64)) -> f64 {
    let ((mut a, mut fa), (mut b, mut fb)) = (from, to);
    for round in 0..200 {
        let tolerance = 2.0 * f64::EPSILON * a.abs().max(b.abs());
        if (b - a).abs() <= tolerance {
            break;
        }
        let secant = b - fb * (b - a) / (fb - fa);
        let inside = secant > a.min(b) && secant < a.max(b);
        let t = if round % 4 == 3 || !inside { 0.5 * (a + b) } else { secant };
        let ft = value(t);
        if ft == 0.0 {
            return t;
        }
        if (ft < 0.0) == (fb < 0.0) {
            fa *= 0.5;
        } else {
            (a, fa) = (b, fb);
        }
        (b, fb) = (t, ft);
    }
    b
}
