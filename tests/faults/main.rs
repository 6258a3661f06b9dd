//! What goes wrong around a server: each fault is made for real, and every byte that a client got is checked.
//!
//! `cargo test --release -p insula-server --test faults`. What wants a program that is not there is reported as ignored.
#![allow(clippy::unwrap_used, reason = "a test may panic")]

#[allow(dead_code, unreachable_pub, reason = "the tests of the whole use more of it")]
#[path = "../harness/bucket.rs"]
mod bucket;
mod client;
#[path = "../../server/tests/common/mod.rs"]
mod common;
mod contract;
mod disk;
mod origin;
mod process;
mod program;
mod store;
mod swap;

use libtest_mimic::{Arguments, Trial};

fn main() {
    let trial = |name: &str, test: fn()| {
        Trial::test(name, move || {
            test();
            Ok(())
        })
    };
    let moto = program::find("moto_server");
    let mut trials = vec![
        trial("archives_cut_and_altered_under_load_give_no_wrong_byte", disk::cut_and_altered),
        trial("a_disk_cache_that_is_damaged_or_gone_gives_no_wrong_byte", disk::cache_damaged_and_gone),
        trial("killed_under_load_it_comes_back_and_gives_no_wrong_byte", process::killed),
        trial("without_file_descriptors_it_goes_on", process::no_descriptors),
        trial("slow_headers_from_many_do_not_keep_others_out", process::slow_headers),
        trial("two_hundred_versions_under_load", swap::two_hundred),
        trial("a_store_that_fails_a_third_of_the_time_is_only_slow", store::failing),
        trial("a_store_that_is_gone_is_503_and_comes_back", store::gone),
        trial("a_store_that_gives_wrong_bytes_gives_none", store::lying),
        trial("a_thousand_requests_for_one_block_are_one_fetch", store::coalesced),
        trial("an_object_replaced_under_the_server_is_never_mixed", store::replaced),
    ];
    let (prlimit, clock) = (program::find("prlimit"), process::libfaketime());
    trials.push(
        trial("at_its_limit_of_memory_it_gives_no_wrong_byte", process::no_memory).with_ignored_flag(prlimit.is_none()),
    );
    trials.push(trial("a_clock_that_jumps_troubles_nobody", process::clock_jumps).with_ignored_flag(clock.is_none()));
    let schemathesis = program::find("schemathesis");
    trials.push(trial("the_openapi_document_is_kept", contract::kept).with_ignored_flag(schemathesis.is_none()));
    trials.push(trial("s3_by_moto_serves_every_tile", store::s3).with_ignored_flag(moto.is_none()));
    libtest_mimic::run(&Arguments::from_args(), trials).exit();
}
