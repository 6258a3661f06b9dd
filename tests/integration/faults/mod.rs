//! Faults around a running server. Each fault is real, and a client checks every byte that it gets. A test that needs a program that
//! is not installed is reported as ignored.

mod client;
mod disk;
mod process;
mod server;
mod store;
mod swap;

use insula_test_support::programs::find_installed;
use insula_tests::trials::{Test, Trials};
use std::process::Command;

pub(crate) fn add(trials: &mut Trials) {
    let has = |name: &str| find_installed(name).is_some();
    trials.add([
        Test::new("truncated_and_altered_archives_give_no_wrong_byte", disk::truncated_and_altered),
        Test::new("a_damaged_or_removed_disk_cache_gives_no_wrong_byte", disk::cache_damaged_and_removed),
        Test::new("a_server_killed_under_load_restarts_and_gives_no_wrong_byte", process::killed),
        Test::new("a_server_without_file_descriptors_recovers", process::no_descriptors),
        Test::new("clients_with_slow_headers_do_not_block_others", process::slow_headers),
        Test::new("a_server_at_its_memory_limit_gives_no_wrong_byte", process::no_memory).ignored_if(!has("prlimit")),
        Test::new("a_jumping_clock_breaks_no_request", process::clock_jumps)
            .ignored_if(process::libfaketime().is_none()),
        Test::new("versions_are_replaced_under_load", swap::replaced_under_load),
        Test::new("a_store_that_fails_for_a_third_of_requests_is_only_slow", store::failing),
        Test::new("an_unreachable_store_is_503_until_it_is_back", store::gone),
        Test::new("wrong_bytes_of_a_store_are_not_served", store::lying),
        Test::new("a_thousand_requests_for_one_block_are_one_fetch", store::coalesced),
        Test::new("a_replaced_object_is_never_mixed_with_the_old_one", store::replaced),
        Test::new("every_tile_is_served_from_s3", store::s3).ignored_if(!has("moto_server")),
        Test::new("a_version_is_served_from_s3_with_what_it_shares", store::version_on_s3)
            .ignored_if(!has("moto_server")),
        // It sends thousands of requests.
        Test::new("responses_match_the_openapi_document", matches_openapi).ignored_if(!has("schemathesis")).full_tier(),
    ]);
}

/// Sends requests made from the document and checks the responses against it.
fn matches_openapi() {
    let (_folder, server) = server::start_small_city(&[]);
    let scratch = tempfile::tempdir().unwrap();
    // A schema cannot say that x and y are below 2^level, so the server refuses some requests that the schema allows.
    let output = Command::new(find_installed("schemathesis").unwrap())
        .args(["run", &format!("http://{}/v1/openapi.json", server.address), "--max-examples", "25", "--seed", "1"])
        .args(["--checks", "all", "--exclude-checks", "positive_data_acceptance", "--no-color"])
        .current_dir(scratch.path())
        .output()
        .unwrap();
    let report = String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success(), "{report}");
    println!("{}", report.lines().filter(|line| line.contains("generated")).collect::<String>());
}
