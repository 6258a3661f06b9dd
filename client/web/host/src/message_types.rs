//! The types of messages in TypeScript, made from those of Rust.

use crate::commands::{
    ColorRules, Command, Direction, Kind, MeasureCommand, Mode, OptionsCommand, Others, ViewerOptions,
};
use crate::messages::{ColorsMessage, FrameMessage, MeasureMessage, ObjectMessage, SchemaMessage, StatusMessage, Step};
use std::fmt::Write;
use std::fs;
use std::path::Path;
use ts_rs::{Config, TS};

/// Adds the declaration of a type with its docs.
fn declare<T: TS>(out: &mut String, config: &Config) {
    let docs = T::docs().unwrap_or_default();
    writeln!(out, "{docs}export {}\n", T::decl(config)).unwrap();
}

#[test]
fn package_has_the_types_of_the_messages() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../package/messages.d.ts");
    let config = Config::default();
    let mut types =
        "/** Messages between the element and its engine. Made from client/web/host/src by a test. */\n\n".to_owned();
    declare::<ViewerOptions>(&mut types, &config);
    declare::<Command>(&mut types, &config);
    declare::<OptionsCommand>(&mut types, &config);
    declare::<MeasureCommand>(&mut types, &config);
    declare::<Direction>(&mut types, &config);
    declare::<Mode>(&mut types, &config);
    declare::<Kind>(&mut types, &config);
    declare::<ColorRules>(&mut types, &config);
    declare::<Others>(&mut types, &config);
    declare::<FrameMessage>(&mut types, &config);
    declare::<MeasureMessage>(&mut types, &config);
    declare::<ObjectMessage>(&mut types, &config);
    declare::<SchemaMessage>(&mut types, &config);
    declare::<ColorsMessage>(&mut types, &config);
    declare::<StatusMessage>(&mut types, &config);
    declare::<Step>(&mut types, &config);
    if std::env::var_os("INSULA_WRITE_TYPES").is_some() {
        fs::write(&path, &types).unwrap();
    }
    let found = fs::read_to_string(&path).unwrap();
    assert!(found == types, "package/messages.d.ts is old: run this test with INSULA_WRITE_TYPES=1");
}
