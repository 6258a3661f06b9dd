//! Runs the faults: `cargo test --release -p insula-faults`, after `cargo build --release -p insula-server`. A test that
//! needs a program that is not installed is reported as ignored.

use insula_faults::{contract, disk, process, store, swap};
use insula_test_support::programs::find_installed;
use libtest_mimic::{Arguments, Trial};

fn main() {
    let trial = |name: &str, test: fn()| {
        Trial::test(name, move || {
            test();
            Ok(())
        })
    };
    let trial_if = |is_possible: bool, name: &str, test: fn()| trial(name, test).with_ignored_flag(!is_possible);
    let has = |name: &str| find_installed(name).is_some();
    let trials = vec![
        trial("truncated_and_altered_archives_give_no_wrong_byte", disk::truncated_and_altered),
        trial("a_damaged_or_removed_disk_cache_gives_no_wrong_byte", disk::cache_damaged_and_removed),
        trial("a_server_killed_under_load_restarts_and_gives_no_wrong_byte", process::killed),
        trial("a_server_without_file_descriptors_recovers", process::no_descriptors),
        trial("clients_with_slow_headers_do_not_block_others", process::slow_headers),
        trial_if(has("prlimit"), "a_server_at_its_memory_limit_gives_no_wrong_byte", process::no_memory),
        trial_if(process::libfaketime().is_some(), "a_jumping_clock_breaks_no_request", process::clock_jumps),
        trial("two_hundred_versions_are_replaced_under_load", swap::two_hundred),
        trial("a_store_that_fails_for_a_third_of_requests_is_only_slow", store::failing),
        trial("an_unreachable_store_is_503_until_it_is_back", store::gone),
        trial("wrong_bytes_of_a_store_are_not_served", store::lying),
        trial("a_thousand_requests_for_one_block_are_one_fetch", store::coalesced),
        trial("a_replaced_object_is_never_mixed_with_the_old_one", store::replaced),
        trial_if(has("moto_server"), "every_tile_is_served_from_s3", store::s3),
        trial_if(has("schemathesis"), "responses_match_the_openapi_document", contract::matches_openapi),
    ];
    libtest_mimic::run(&Arguments::from_args(), trials).exit();
}
