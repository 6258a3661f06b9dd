//! What nodes draw lies within their stated errors, and the source within those of what is drawn.

use anyhow::{Result, ensure};
use insula_test_support::tier;
use insula_tests::baked::Baked;
use insula_tests::compare::percentile;
use insula_tests::trials::{Trials, WHOLE_CITY};
use insula_tests::truth::Truth;
use insula_tests::{fidelity, fixtures, node_error, tests};

pub(crate) fn add(trials: &mut Trials) {
    trials.add(tests![points_lie_within_the_errors_of_their_nodes].map(|test| test.in_turn(&WHOLE_CITY)));
}

fn points_lie_within_the_errors_of_their_nodes() -> Result<()> {
    let inputs = fixtures::chiba()?;
    let baked = Baked::open(&fixtures::baked_chiba()?)?;
    let samples = if tier::is_full() { 40_000 } else { 10_000 };
    let levels = node_error::measure(&Truth::new(fidelity::read(&inputs)?), &baked, samples, 200.0)?;
    ensure!(levels.len() > 4, "{} levels", levels.len());
    for level in &levels {
        let shares = [level.drawn_to_source.within, level.source_to_drawn.within];
        ensure!(shares.iter().all(|share| *share >= 0.999), "level {}: {shares:?}", level.level);
        // The field, by which the bake measures too, is what the ray-caster draws.
        let apart = [0.99, 0.999].map(|share| percentile(&level.field_errors, share));
        ensure!(apart[0] < 0.02 && apart[1] < 0.1, "level {}: {apart:?} cells between field and frame", level.level);
    }
    // Half the diagonal of a voxel is not enough, in either direction.
    let least = |share: fn(&node_error::LevelError) -> f64| levels.iter().map(share).fold(1.0, f64::min);
    let nominal = [least(|l| l.drawn_to_source.within_nominal), least(|l| l.source_to_drawn.within_nominal)];
    ensure!(nominal.iter().all(|share| *share < 0.999), "{nominal:?}");
    Ok(())
}
