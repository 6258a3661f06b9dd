//! `bake`: city files into a city.
//!
//! In: what was typed. Out: a city's folder, a report, a progress bar on a terminal. Next: `serve`.

use super::error::CommandError;
use crate::args::BakeArgs;

/// Says that this program cannot.
#[cfg(not(feature = "bake"))]
pub(super) fn run(_args: &BakeArgs) -> Result<(), CommandError> {
    Err(CommandError::Bake("this program only serves; bake with one that was built with the feature `bake`".into()))
}

#[cfg(feature = "bake")]
pub(super) use with_bake::run;

#[cfg(feature = "bake")]
mod with_bake {
    use super::{BakeArgs, CommandError};
    use crate::{
        args::{UpAxis, VisibilityRenderer},
        commands::output::{human_bytes, print, write},
    };
    use indicatif::{ProgressBar, ProgressStyle};
    use insula_bake::{
        BakeError, BakeOptions, BakeReport, Progress,
        read::{ObjUpAxis, Palette},
        sample::{SampleSettings, Visibility},
    };
    use insula_protocol::manifest::Attribution;
    use std::{
        io::IsTerminal,
        sync::{Mutex, PoisonError},
        time::Duration,
    };

    const ENDLESS: &str = "{prefix:>10} {spinner} {elapsed}";
    const ENDING: &str = "{prefix:>10} {wide_bar} {percent:>3}% {elapsed}, {eta} left";

    pub(in crate::commands) fn run(args: &BakeArgs) -> Result<(), CommandError> {
        let palette = match &args.palette {
            Some(path) => Palette::read(path).map_err(|error| CommandError::Bake(error.to_string()))?,
            None => Palette::default(),
        };
        let bars = ProgressBars::default();
        let result = insula_bake::bake(&options(args, palette), &bars);
        bars.clear();
        let report = result.map_err(|error| match error {
            BakeError::Option { .. } => CommandError::Usage(error.to_string()),
            error => CommandError::Bake(error.to_string()),
        })?;
        if let Some(path) = &args.report {
            let json = serde_json::to_vec_pretty(&report)
                .map_err(|error| CommandError::Write { path: path.clone(), reason: error.to_string() })?;
            write(path, &json)?;
        }
        print(&summary(&report, args));
        Ok(())
    }

    fn options(args: &BakeArgs, palette: Palette) -> BakeOptions {
        let attribution = args.attribution.clone().map(|text| Attribution {
            text,
            licence: args.licence.clone(),
            url: args.source_url.clone(),
        });
        BakeOptions {
            inputs: args.inputs.clone(),
            out: args.out.clone(),
            cell_m: args.cell,
            quality: args.quality,
            meshes: !args.no_meshes,
            threads: args.threads.map(usize::from),
            memory_bytes: args.memory,
            update: args.update,
            resume: args.resume,
            name: args.name.clone(),
            title: args.title.clone(),
            attribution: attribution.into_iter().collect(),
            obj_up: match args.obj_up {
                UpAxis::Z => ObjUpAxis::Z,
                UpAxis::Y => ObjUpAxis::Y,
            },
            palette,
            sample: SampleSettings {
                visibility: match args.visibility {
                    VisibilityRenderer::Cpu => Visibility::Cpu,
                    VisibilityRenderer::Gpu => Visibility::Gpu,
                },
                ..SampleSettings::default()
            },
        }
    }

    fn summary(report: &BakeReport, args: &BakeArgs) -> String {
        let skipped = match report.read.skipped() {
            0 => String::new(),
            n => format!(", {n} objects skipped (--report says why)"),
        };
        let unchanged = match report.blocks_unchanged {
            0 => String::new(),
            n => format!(", {n} of {} blocks unchanged", n + report.blocks_baked + report.blocks_resumed),
        };
        let memory = report
            .peak_memory_bytes
            .map_or(String::new(), |bytes| format!(", at most {} of memory", human_bytes(bytes)));
        let meshes = match report.meshes.first() {
            None => String::new(),
            Some(finest) => {
                let bytes = report.meshes.iter().map(|lod| lod.bytes).sum();
                format!(", meshes of {} leaves ({})", finest.leaves, human_bytes(bytes))
            }
        };
        format!(
            "{}: {} objects, {} triangles in {:.1} s ({:.0} objects/s, {:.0} triangles/s{memory}): {} nodes, {}{meshes}\
             {unchanged}{skipped}\nserve it with: insula-server serve {}\n",
            report.name,
            report.objects,
            report.triangles,
            report.seconds,
            report.objects_per_second,
            report.triangles_per_second,
            report.nodes,
            human_bytes(report.city_bytes),
            args.out.display(),
        )
    }

    /// One bar at a time, on standard error; nothing if that is no terminal. The remaining time comes from the steps of
    /// the present stage alone, and a stage whose end is not known shows none.
    #[derive(Default)]
    struct ProgressBars {
        now: Mutex<Option<ProgressBar>>,
    }

    impl ProgressBars {
        fn clear(&self) {
            if let Some(bar) = self.now.lock().unwrap_or_else(PoisonError::into_inner).take() {
                bar.finish_and_clear();
            }
        }
    }

    impl Progress for ProgressBars {
        fn stage(&self, name: &str, total: u64) {
            self.clear();
            if !std::io::stderr().is_terminal() {
                return;
            }
            let (bar, template) = match total {
                0 => (ProgressBar::new_spinner(), ENDLESS),
                total => (ProgressBar::new(total), ENDING),
            };
            // A wrong template would only cost the looks, and a test knows that they are right.
            let style = ProgressStyle::with_template(template).unwrap_or_else(|_| ProgressStyle::default_bar());
            let bar = bar.with_style(style).with_prefix(name.to_owned());
            bar.enable_steady_tick(Duration::from_millis(200));
            *self.now.lock().unwrap_or_else(PoisonError::into_inner) = Some(bar);
        }

        fn advance(&self, n: u64) {
            if let Some(bar) = &*self.now.lock().unwrap_or_else(PoisonError::into_inner) {
                bar.inc(n);
            }
        }
    }

    #[cfg(test)]
    mod tests {
        use super::*;
        use crate::args::{Args, ServerCommand};
        use clap::Parser;

        #[test]
        fn templates_are_right() {
            for template in [ENDLESS, ENDING] {
                ProgressStyle::with_template(template).unwrap();
            }
        }

        #[test]
        fn what_was_typed_reaches_the_bake() {
            let line = "insula-server bake a b --out c --cell 0.5 --threads 3 --resume --update --memory 2GiB --name n --title T \
                --attribution A --licence L --source-url U --obj-up y --no-meshes";
            let ServerCommand::Bake(args) = Args::parse_from(line.split_whitespace()).command else {
                panic!("no bake")
            };
            let options = options(&args, Palette::default());
            assert_eq!(options.inputs, [std::path::Path::new("a"), std::path::Path::new("b")]);
            assert_eq!((options.cell_m, options.threads, options.resume), (0.5, Some(3), true));
            assert!(!options.meshes);
            assert_eq!((options.update, options.memory_bytes), (true, Some(2 << 30)));
            assert_eq!((options.name.as_deref(), options.title.as_deref()), (Some("n"), Some("T")));
            assert_eq!(options.obj_up, ObjUpAxis::Y);
            let [source] = &options.attribution[..] else { panic!("{:?}", options.attribution) };
            assert_eq!((&*source.text, source.licence.as_deref(), source.url.as_deref()), ("A", Some("L"), Some("U")));
        }
    }
}
