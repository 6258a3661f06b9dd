//! Plans for tests: known ones, and strategies for random ones.

use proptest::prelude::*;
use std::f64::consts::TAU;

pub(super) type Rings = Vec<Vec<[f64; 2]>>;

pub(super) fn ring(corners: &[(f64, f64)]) -> Vec<[f64; 2]> {
    corners.iter().map(|&(x, y)| [x, y]).collect()
}

pub(super) fn rectangle(length: f64, width: f64) -> Rings {
    vec![ring(&[(0.0, 0.0), (length, 0.0), (length, width), (0.0, width)])]
}

pub(super) fn l_shape() -> Rings {
    vec![ring(&[(0.0, 0.0), (20.0, 0.0), (20.0, 8.0), (8.0, 8.0), (8.0, 18.0), (0.0, 18.0)])]
}

pub(super) fn t_shape() -> Rings {
    let corners =
        [(0.0, 0.0), (20.0, 0.0), (20.0, 7.0), (13.0, 7.0), (13.0, 18.0), (6.0, 18.0), (6.0, 7.0), (0.0, 7.0)];
    vec![ring(&corners)]
}

/// A cross with four equal arms: twelve edges and four reflex corners end at one time.
pub(super) fn cross() -> Rings {
    let quarter = [(8.0, 0.0), (14.0, 0.0), (14.0, 8.0)];
    let turned = |turns: usize| quarter.map(|(x, y)| (0..turns).fold((x - 11.0, y - 11.0), |(x, y), _| (-y, x)));
    vec![ring(&(0..4).flat_map(turned).collect::<Vec<_>>())]
}

/// A rectangle around a courtyard, with wings of equal width.
pub(super) fn courtyard() -> Rings {
    let mut rings = rectangle(24.0, 20.0);
    rings.push(ring(&[(6.0, 6.0), (6.0, 14.0), (18.0, 14.0), (18.0, 6.0)]));
    rings
}

pub(super) fn regular(corners: usize, radius: f64) -> Rings {
    vec![(0..corners).map(|i| on_circle(radius, i as f64 / corners as f64)).collect()]
}

fn on_circle(radius: f64, turns: f64) -> [f64; 2] {
    let (y, x) = (turns * TAU).sin_cos();
    [radius * x, radius * y]
}

/// Teeth of 4 m on a bar, with gaps of 2 m.
pub(super) fn comb(teeth: &[f64]) -> Rings {
    let mut corners = vec![(0.0, 0.0), (teeth.len() as f64 * 6.0 - 2.0, 0.0)];
    for (i, height) in teeth.iter().enumerate().rev() {
        let left = i as f64 * 6.0;
        corners.extend([(left + 4.0, 5.0 + height), (left, 5.0 + height)]);
        if i > 0 {
            corners.extend([(left, 5.0), (left - 2.0, 5.0)]);
        }
    }
    // The last tooth's right side continues the bar's.
    vec![ring(&corners)]
}

/// Turns and moves a plan.
pub(super) fn placed(rings: &Rings, turns: f64, offset: [f64; 2]) -> Rings {
    let [cosine, sine] = on_circle(1.0, turns);
    let place = |&[x, y]: &[f64; 2]| [offset[0] + x * cosine - y * sine, offset[1] + x * sine + y * cosine];
    rings.iter().map(|ring| ring.iter().map(place).collect()).collect()
}

/// Corners around a centre at random distances.
pub(super) fn star() -> impl Strategy<Value = Rings> {
    prop::collection::vec((1.0..20.0_f64, 0.1..1.0_f64), 3..40)
        .prop_map(|steps| {
            let sum: f64 = steps.iter().map(|(_, step)| step).sum();
            let mut turns = 0.0;
            let corner = |&(radius, step): &(f64, f64)| {
                turns += step / sum;
                on_circle(radius, turns)
            };
            vec![steps.iter().map(corner).collect()]
        })
        // Three or four corners may leave the centre outside.
        .prop_filter("turns the other way", |rings: &Rings| super::check::footprint_area(rings) > 0.1)
}

/// Columns of whole heights, above and below a common row: many edges end at one time.
pub(super) fn columns() -> impl Strategy<Value = Rings> {
    prop::collection::vec((1..9_i32, 0..6_i32, 1..4_i32), 1..16).prop_map(|columns| {
        let (mut top, mut bottom, mut x) = (Vec::new(), Vec::new(), 0.0);
        for (high, low, width) in columns {
            let right = x + f64::from(width);
            top.extend([(x, f64::from(high)), (right, f64::from(high))]);
            bottom.extend([(x, -f64::from(low)), (right, -f64::from(low))]);
            x = right;
        }
        bottom.extend(top.into_iter().rev());
        bottom.dedup();
        vec![ring(&bottom)]
    })
}

/// A rectangle with courtyards in a grid.
pub(super) fn courtyards() -> impl Strategy<Value = Rings> {
    let hole = prop::option::of((0.5..4.0_f64, 0.5..4.0_f64, 5.0..8.0_f64, 5.0..8.0_f64));
    (1..4_usize, prop::collection::vec(hole, 1..9)).prop_map(|(columns, holes)| {
        let rows = holes.len().div_ceil(columns);
        let mut rings = rectangle(columns as f64 * 9.0, rows as f64 * 9.0);
        for (i, hole) in holes.iter().enumerate() {
            let (x, y) = ((i % columns) as f64 * 9.0, (i / columns) as f64 * 9.0);
            if let Some((west, south, east, north)) = *hole {
                let corners = [(west, south), (west, north), (east, north), (east, south)];
                rings.push(ring(&corners.map(|(u, v)| (x + u, y + v))));
            }
        }
        rings
    })
}

/// A plan as surveyors draw it: further corners on its walls, off their lines by up to `noise_m`.
pub(super) fn drawn(plan: impl Strategy<Value = Rings>, noise_m: f64) -> impl Strategy<Value = Rings> {
    let further = prop::collection::vec((0.05..0.95_f64, -noise_m..=noise_m, any::<bool>()), 80);
    (plan, further).prop_map(|(rings, further)| {
        let mut further = further.into_iter().cycle();
        let with_further = |ring: &Vec<[f64; 2]>| {
            let mut corners = Vec::new();
            for (i, &a) in ring.iter().enumerate() {
                let b = ring[(i + 1) % ring.len()];
                corners.push(a);
                if let Some((share, noise_m, true)) = further.next() {
                    let along = [b[0] - a[0], b[1] - a[1]];
                    let length = along[0].hypot(along[1]);
                    let off = noise_m / length;
                    corners.push([a[0] + share * along[0] - off * along[1], a[1] + share * along[1] + off * along[0]]);
                }
            }
            corners
        };
        rings.iter().map(with_further).collect()
    })
}

/// A plan with every corner moved by up to `noise_m`: edges that were parallel are nearly parallel.
pub(super) fn jittered(plan: impl Strategy<Value = Rings>, noise_m: f64) -> impl Strategy<Value = Rings> {
    let noise = prop::collection::vec((-noise_m..=noise_m, -noise_m..=noise_m), 80);
    (plan, noise).prop_map(|(mut rings, noise)| {
        for (corner, (x, y)) in rings.iter_mut().flatten().zip(noise.into_iter().cycle()) {
            *corner = [corner[0] + x, corner[1] + y];
        }
        rings
    })
}

/// A plan whose corners are cut off by edges of about `cut_m`.
pub(super) fn chamfered(plan: impl Strategy<Value = Rings>, cut_m: f64) -> impl Strategy<Value = Rings> {
    let towards = move |a: [f64; 2], b: [f64; 2]| {
        let share = cut_m / (b[0] - a[0]).hypot(b[1] - a[1]);
        [a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1])]
    };
    let cut = move |ring: &Vec<[f64; 2]>| {
        let at = |i: usize| ring[i % ring.len()];
        let corner = |i: usize| [towards(at(i), at(i + ring.len() - 1)), towards(at(i), at(i + 1))];
        (0..ring.len()).flat_map(corner).collect()
    };
    plan.prop_map(move |rings| rings.iter().map(cut).collect())
}

/// Any of these, in any direction and place.
pub(super) fn any_plan() -> impl Strategy<Value = Rings> {
    let plan = prop_oneof![
        star(),
        columns(),
        courtyards(),
        drawn(columns(), 0.0),
        drawn(columns(), 0.008),
        drawn(courtyards(), 1e-7),
        drawn(star(), 0.02),
        jittered(columns(), 1e-9),
        jittered(columns(), 1e-4),
        jittered(columns(), 1e-3),
        chamfered(columns(), 0.0015),
        chamfered(courtyards(), 0.05),
    ];
    anywhere(plan)
}

/// Plans whose parallels are off by about the distance below which points coincide.
pub(super) fn nearly_degenerate() -> impl Strategy<Value = Rings> {
    anywhere(prop_oneof![
        jittered(columns(), 1e-7),
        jittered(columns(), 1e-6),
        jittered(columns(), 1e-5),
        jittered(courtyards(), 1e-6),
        drawn(columns(), 1e-6),
    ])
}

fn anywhere(plan: impl Strategy<Value = Rings>) -> impl Strategy<Value = Rings> {
    let turns = prop_oneof![Just(0.0), Just(0.25), 0.0..1.0_f64];
    let offset = prop_oneof![Just([0.0, 0.0]), Just([431_234.567, 5_412_345.678])];
    (plan, turns, offset).prop_map(|(rings, turns, offset)| placed(&rings, turns, offset))
}
