//! Shadows at the times of `--time` and `--times`.

use super::super::error::CommandError;
use super::Files;
use crate::analysis::answer::{Answer, TIMES_IN_SHADOW};
use crate::args::AnalyseArgs;
use insula_analysis::clock::{Moment, TimeSystem};
use insula_analysis::sun::Site;
use insula_analysis::surface::CitySurface;
use std::path::{Path, PathBuf};

/// Most times of one run: each is a file.
const MAX_TIMES: usize = 1000;

/// Which times `shadow` is asked for, and the files of each: with the time in their names if there are several.
pub(super) fn files(args: &AnalyseArgs) -> Result<Vec<(Moment, Files)>, CommandError> {
    let moments = moments(args)?;
    let own = Files::of(args);
    match moments.len() {
        0 => Err(CommandError::Usage("shadow needs --time, as in 2025-12-21T10:00+01:00, or --times".to_owned())),
        1 => Ok(moments.into_iter().map(|moment| (moment, own.clone())).collect()),
        _ => {
            let files = |moment: &Moment| Files {
                out: with_time(&own.out, moment),
                pdf: own.pdf.as_deref().map(|path| with_time(path, moment)),
            };
            Ok(moments.into_iter().map(|moment| (moment.clone(), files(&moment))).collect())
        }
    }
}

fn with_time(path: &Path, moment: &Moment) -> PathBuf {
    let [stem, extension] = [path.file_stem(), path.extension()].map(Option::unwrap_or_default);
    let [stem, extension] = [stem, extension].map(|part| part.to_string_lossy());
    path.with_file_name(format!("{stem}-{}.{extension}", moment.at.format("%Y-%m-%dT%H%M")))
}

fn moments(args: &AnalyseArgs) -> Result<Vec<Moment>, CommandError> {
    let wrong = |option: &str, reason: String| CommandError::Usage(format!("{option}: {reason}"));
    let system = args.time_zone.as_deref().map_or(Ok(TimeSystem::MeanSolar), TimeSystem::parse);
    let system = system.map_err(|reason| wrong("--time-zone", reason))?;
    let single = args.time.iter().map(|text| Moment::parse(text, &system));
    let mut moments = single.collect::<Result<Vec<_>, _>>().map_err(|reason| wrong("--time", reason))?;
    if let Some(text) = &args.times {
        moments.extend(
            Moment::range(text, &system, MAX_TIMES).map_err(|reason| wrong("--times", format!("{text}: {reason}")))?,
        );
    }
    if moments.len() > MAX_TIMES {
        return Err(wrong("--times", format!("{} times, of which {MAX_TIMES} fit in one run", moments.len())));
    }
    Ok(moments)
}

pub(super) fn at(surface: &CitySurface, site: &Site, moment: &Moment) -> Result<Answer, CommandError> {
    let answer = Answer::of_shadow(surface, site, moment);
    answer.ok_or_else(|| CommandError::Usage(format!("{moment}: the sun's place is not known")))
}

/// At how many times shadow lies on each cell, or how many more there are after a proposal.
#[derive(Default)]
pub(super) struct ShadowSum {
    times: usize,
    /// Titles of the first and the last one.
    ends: [String; 2],
    all: Answer,
}

impl ShadowSum {
    /// Adds the shadow at a time.
    pub(super) fn add(&mut self, answer: &Answer) {
        if self.times == 0 {
            self.all.is_change = answer.is_change;
            self.all.tops = vec![0.0; answer.tops.len()];
            self.ends[0].clone_from(&answer.title);
        }
        self.times += 1;
        self.all.tops.iter_mut().zip(&answer.tops).for_each(|(sum, value)| *sum += value);
        self.ends[1].clone_from(&answer.title);
    }

    /// All times together.
    pub(super) fn answer(self) -> Answer {
        let [first, last] = self.ends;
        let notes = vec![format!("first: {first}"), format!("last: {last}")];
        Answer { title: format!("shadow at {} times", self.times), column: TIMES_IN_SHADOW, notes, ..self.all }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_in_shadow_are_counted() {
        let mut sum = ShadowSum::default();
        for (title, tops) in [("nine", vec![1.0, 0.0, f32::NAN]), ("ten", vec![1.0, 1.0, f32::NAN])] {
            sum.add(&Answer { title: title.to_owned(), tops, ..Answer::default() });
        }
        let answer = sum.answer();
        assert_eq!((&answer.tops[..2], answer.title.as_str()), (&[2.0, 1.0][..], "shadow at 2 times"));
        assert!(answer.tops[2].is_nan() && answer.notes == ["first: nine", "last: ten"]);
    }
}
