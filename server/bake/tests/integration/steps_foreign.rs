//! Bakes in steps leave the files of others alone.

use super::steps::{options, write_town};
use insula_bake::{BakeOptions, BakeStage, BakeSteps, GroundOption, Job, JobRequest, Silent, WorkFolder};
use insula_test_support::folder::TestFolder;
use std::fs;

#[test]
fn objects_of_others_in_a_work_store_stay() {
    let folder = TestFolder::new("steps-foreign");
    let work = folder.path.join("work");
    let store = WorkFolder::new(&work);
    let write = |name: &str| {
        fs::create_dir_all(work.join(name).parent().unwrap()).unwrap();
        fs::write(work.join(name), "dear").unwrap();
    };
    let request = |is_update| JobRequest { arguments: Vec::new(), chunk_bytes: 1, region_leaves: 4, is_update };
    let options = BakeOptions {
        out: folder.path.join("plain"),
        ground: GroundOption::None,
        ..options(write_town(&folder.path, [139.75, 35.68], 1))
    };
    let begin = |is_update| BakeSteps::begin(&store, &options, &request(is_update), &Silent);
    // A folder with a job of something else, and one with files where steps write theirs.
    for name in ["job.json", "tiles/holiday.png", "pic/My photos/a.png"] {
        write(name);
        let refused = begin(true).unwrap_err().to_string();
        assert!(refused.contains(name) && refused.contains("no bake wrote it"), "{refused}");
        assert!(
            name != "job.json" || insula_bake::abort(&store).unwrap_err().to_string().contains("nothing is removed")
        );
        assert_eq!(fs::read(work.join(name)).unwrap(), b"dear");
        fs::remove_dir_all(&work).unwrap();
    }
    // Inputs in the store would be removed with it.
    let inside = BakeOptions { inputs: write_town(&folder.path, [139.75, 35.68], 1), ..options.clone() };
    fs::create_dir_all(work.join("in")).unwrap();
    fs::rename(&inside.inputs[0], work.join("in/town-0.geojson")).unwrap();
    let pattern = BakeOptions { inputs: vec![work.join("in/*.geojson")], ..inside };
    let refused = BakeSteps::begin(&store, &pattern, &request(false), &Silent).unwrap_err().to_string();
    assert!(refused.contains("input") && refused.contains("--work"), "{refused}");
    fs::rename(work.join("in/town-0.geojson"), &options.inputs[0]).unwrap();
    begin(false).unwrap();
    let run = |stage: BakeStage| {
        BakeSteps::open(&store, Job::read(&store).unwrap(), &options, &Silent).unwrap().run(stage, 0)
    };
    [BakeStage::Scan, BakeStage::Plan].into_iter().for_each(|stage| run(stage).unwrap());
    let foreign =
        ["notes.txt", "plan/notes.txt", "scan/0/My photo.png", "tiles/holiday.png", "city/impressum.html", "list/mine"];
    foreign.into_iter().for_each(write);
    // Somebody has put something else in the place of a result.
    write("scan/0/records");
    // No step replaces what it did not write.
    write("shuffle/0/bundles");
    assert!(run(BakeStage::Shuffle).unwrap_err().to_string().contains("no step of a bake wrote it"));
    let kept = || {
        foreign.iter().chain(&["scan/0/records", "shuffle/0/bundles"]).for_each(|name| {
            assert_eq!(fs::read(work.join(name)).unwrap(), b"dear", "{name}");
        })
    };
    // An update removes what the job before wrote.
    let text = fs::read_to_string(&options.inputs[0]).unwrap();
    fs::write(&options.inputs[0], text + " ").unwrap();
    begin(true).unwrap();
    kept();
    assert!(!work.join("plan/plan").exists() && !work.join("scan/0/head").exists());
    let aborted = insula_bake::abort(&store).unwrap();
    kept();
    for name in &foreign[1..5] {
        assert!(aborted.kept.iter().any(|kept| kept == name), "{name}: {:?}", aborted.kept);
    }
    assert!(!work.join("job.json").exists() && work.join("insula-work").exists());
}
