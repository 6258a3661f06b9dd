//! `publish`: writes a static web site with the viewer and cities, for any host that answers range requests.
//!
//! ```text
//! SITE/index.html                 the list of cities; of a single city, its page
//!      assets/HASH/FILE           the viewer; FILE.br and FILE.gz for hosts that send compressed files
//!      cities/NAME/index.html     page, and beside it the files of the city
//!      cities/NAME/item.json, catalog.json, collections.json, collections/NAME.json    for catalogues and GIS (`discovery`)
//!      cities/NAME/3dtiles/       with --tileset
//!      cities/NAME/proposals.json with --proposals
//!      404.html                   for wrong addresses
//!      service-worker.js
//!      insula-site.json           marks the folder, and lists its files with their hashes: only what is on the list is ever removed
//! ```

use super::error::CommandError;
use super::output::print_result;
use super::site_documents::{write_documents, write_proposals, write_tileset};
use super::site_folder::SiteFolder;
use crate::args::PublishArgs;
use crate::config::ServeConfig;
use crate::page::{
    self, Brand, CityFacts, CityInList, CityLinks, CityListPage, Languages, SERVICE_WORKER_FILE, ViewerAssets,
    escape_html, list_policy, meta_policy, viewer_policy,
};
use crate::store::{CityStore, Store};
use insula_archive::city::{MANIFEST_FILE, SEARCH_FILE};
use insula_archive::places::KeptFolder;
use insula_command_line::output::Outputs;
use insula_protocol::release::SharedCity;
use insula_protocol::route::{THUMBNAIL_FILE, without_secrets};
use insula_protocol::text::{count, human_bytes};
use std::sync::Arc;

/// What many hosts of files answer for an address that leads to no file.
const WRONG_ADDRESS_FILE: &str = "404.html";

/// Runs `publish` with the viewer of this program.
pub(super) fn run(args: &PublishArgs) -> Result<(), CommandError> {
    publish_site(args, &ViewerAssets::embedded().ok_or(CommandError::NoViewer)?)
}

/// Writes the site, and prints a summary. Fails if a city cannot be opened or changes meanwhile, if the folder holds anything but a
/// site, or if it cannot be written; the old site then stays.
pub fn publish_site(args: &PublishArgs, viewer: &ViewerAssets) -> Result<(), CommandError> {
    if let Some(url) = args.cities.iter().find(|city| city.to_string_lossy().contains("://")) {
        let reason = "only folders can be published; download the city first";
        return Err(CommandError::Usage(format!("{}: {reason}", url.display())));
    }
    let brand = brand(args)?;
    let store = Store::open(&args.cities)?;
    let cities: Vec<&Arc<CityStore>> = store.cities().collect();
    check_shared(&store)?;
    let mut outputs = Outputs::default().reading(cities.iter().filter_map(|city| city.folder()));
    // What of a site is replaced, its list of files says.
    outputs.folder(&args.out, Some(KeptFolder::Site), |_| true).map_err(CommandError::Usage)?;
    let mut site = SiteFolder::create(&args.out)?;
    write_viewer(&mut site, viewer)?;
    for city in &cities {
        write_city(&mut site, city)?;
        if args.tileset {
            write_tileset(&mut site, city)?;
        }
        let has_proposals = write_proposals(&mut site, city, &brand)?;
        let manifests = cities.iter().map(|city| city.manifest());
        let versions = page::versions_of(city.manifest(), manifests, |name| format!("../{name}/"));
        let links = CityLinks { has_proposals, versions, ..in_city_folder(city, args, cities.len()) };
        let html = page::city_page(CityFacts::of(city), &links, viewer, &brand);
        site.write(&format!("cities/{}/index.html", city.manifest().name), html.as_bytes())?;
    }
    let index = match &cities[..] {
        [city] => {
            let has_proposals = brand.proposals_of(&city.manifest().name).is_some();
            let links = CityLinks { has_proposals, ..in_root(city, args) };
            page::city_page(CityFacts::of(city), &links, viewer, &brand)
        }
        cities => list(cities, viewer, args, &brand),
    };
    site.write("index.html", index.as_bytes())?;
    write_documents(&mut site, &cities, brand.title(), args.url.as_deref())?;
    site.write(WRONG_ADDRESS_FILE, wrong_address(&cities, viewer, args, &brand).as_bytes())?;
    for city in brand.start_cities().filter(|name| store.city(name).is_none()) {
        eprintln!("note: site.start: no city of the name {city} is published: check its spelling");
    }
    let names: Vec<_> = cities.iter().map(|city| &city.manifest().name).collect();
    let about = serde_json::json!({ "assets": viewer.hash(), "cities": names });
    let (files, bytes) = site.publish(about)?;
    let text = format!(
        "{}: {}, {}: any web server that answers range requests can serve it\n",
        args.out.display(),
        count(files, "file"),
        human_bytes(bytes)
    );
    let facts = serde_json::json!({ "out": args.out.display().to_string(), "files": files, "bytes": bytes });
    print_result(args.json, &facts, &text);
    Ok(())
}

/// Fails if a city has tiles in one that is not published.
fn check_shared(store: &Store) -> Result<(), CommandError> {
    for city in store.cities() {
        let is_there = |shared: &SharedCity| {
            store.city(&shared.name).is_some_and(|found| found.manifest().version == shared.version)
        };
        if let Some(missing) = city.manifest().shared().iter().find(|shared| !is_there(shared)) {
            let (name, other) = (&city.manifest().name, &missing.name);
            let reason = format!("the city {name} shares tiles with the city {other}; name the folder of {other}, too");
            return Err(CommandError::Usage(reason));
        }
    }
    Ok(())
}

/// What the settings say of pages; the command line's title comes first.
fn brand(args: &PublishArgs) -> Result<Brand, CommandError> {
    let mut site = ServeConfig::load(args.config.as_deref(), [], &[])?.site;
    if let Some(title) = &args.title {
        site.title.clone_from(title);
    }
    if let Some(folder) = &args.proposals {
        if !folder.is_dir() {
            let text = folder.to_string_lossy();
            let place = without_secrets(&text);
            return Err(CommandError::Usage(format!("--proposals {place}: there is no such folder")));
        }
        site.proposals = Some(folder.clone());
    }
    let logo = site.logo.clone().unwrap_or_default();
    Brand::load(&site).map_err(|error| CommandError::file(logo, error))
}

fn write_viewer(site: &mut SiteFolder, viewer: &ViewerAssets) -> Result<(), CommandError> {
    for (name, file) in viewer.files() {
        if name == SERVICE_WORKER_FILE {
            site.write(name, &file.plain)?;
            continue;
        }
        for (suffix, bytes) in [("", &file.plain), (".br", &file.brotli), (".gz", &file.gzip)] {
            site.write(&format!("{}{name}{suffix}", viewer.folder("")), bytes)?;
        }
    }
    Ok(())
}

/// Links or copies the files of a city that viewers read.
fn write_city(site: &mut SiteFolder, city: &CityStore) -> Result<(), CommandError> {
    let Some(folder) = city.folder() else { return Ok(()) };
    let archives = city.archives().map(|(kind, _)| kind.file_name());
    let optional =
        city.has_search().then_some(SEARCH_FILE).into_iter().chain(city.has_thumbnail.then_some(THUMBNAIL_FILE));
    for name in archives.chain([MANIFEST_FILE]).chain(optional) {
        site.link(&folder.join(name), &format!("cities/{}/{name}", city.manifest().name))?;
    }
    if city.is_unchanged() {
        return Ok(());
    }
    Err(CommandError::file(folder, "it was replaced meanwhile; run the command again"))
}

/// The links of a city's page in the city's folder.
fn in_city_folder(city: &CityStore, args: &PublishArgs, cities: usize) -> CityLinks {
    CityLinks {
        source: "./".into(),
        root: "../../".into(),
        thumbnail: city.has_thumbnail.then(|| THUMBNAIL_FILE.to_owned()),
        list: (cities > 1).then(|| "../../".to_owned()),
        ..links(city, args)
    }
}

/// The links of a city's page or entry in the site's folder.
fn in_root(city: &CityStore, args: &PublishArgs) -> CityLinks {
    let folder = format!("cities/{}/", city.manifest().name);
    CityLinks {
        thumbnail: city.has_thumbnail.then(|| format!("{folder}{THUMBNAIL_FILE}")),
        source: folder,
        ..links(city, args)
    }
}

fn links(city: &CityStore, args: &PublishArgs) -> CityLinks {
    let folder = args.url.as_ref().map(|url| format!("{url}cities/{}/", city.manifest().name));
    CityLinks {
        preview: folder.as_ref().filter(|_| city.has_thumbnail).map(|folder| format!("{folder}{THUMBNAIL_FILE}")),
        canonical: folder,
        is_public: true,
        meta_policy: Some(meta_policy(viewer_policy())),
        ..CityLinks::default()
    }
}

fn list(cities: &[&Arc<CityStore>], viewer: &ViewerAssets, args: &PublishArgs, brand: &Brand) -> String {
    let icon = viewer.folder("") + "icon.svg";
    let (policy, languages) = (meta_policy(list_policy()), Languages::of(Some(viewer)));
    let icon = viewer.has("icon.svg").then_some(icon.as_str());
    let mut page = CityListPage::new(brand, languages.english(), icon, Some(&policy));
    for city in cities {
        let links = in_root(city, args);
        page.push_city(&CityInList { facts: CityFacts::of(city), page: Some(links.source.clone()), links });
    }
    page.finish()
}

/// The page for wrong addresses, with a link to the site's start. It is shown at addresses of any depth, so its links are whole ones:
/// without `--url`, the site is thought to be all of its host.
fn wrong_address(cities: &[&Arc<CityStore>], viewer: &ViewerAssets, args: &PublishArgs, brand: &Brand) -> String {
    let root = args.url.as_deref().unwrap_or("/");
    let icon = viewer.folder(root) + "icon.svg";
    let (policy, languages) = (meta_policy(list_policy()), Languages::of(Some(viewer)));
    let texts = languages.english();
    let icon = viewer.has("icon.svg").then_some(icon.as_str());
    let mut page = CityListPage::new(brand, texts, icon, Some(&policy));
    let start = match cities {
        [city] => &city.manifest().title,
        _ => &texts.cities,
    };
    page.push_paragraph(&format!("<strong>{}</strong>", escape_html(&texts.not_found)));
    page.push_paragraph(&escape_html(&texts.not_found_hint));
    page.push_paragraph(&format!("<a href=\"{}\">{}</a>", escape_html(root), escape_html(start)));
    page.finish()
}

#[cfg(test)]
mod tests {
    use super::*;
    use insula_test_support::small_city;
    use std::fs;

    #[test]
    fn wrong_addresses_lead_to_the_start() {
        let folder = tempfile::tempdir().unwrap();
        let (one, other, out) = (folder.path().join("one"), folder.path().join("other"), folder.path().join("site"));
        small_city::write_city(&one, "one");
        small_city::write_city(&other, "other");
        let viewer = ViewerAssets::new("00112233445566ff", []);
        let publish = |cities: &[&std::path::PathBuf], url: Option<&str>| {
            let cities = cities.iter().map(|city| (*city).clone()).collect();
            let url = url.map(str::to_owned);
            let args = PublishArgs { cities, out: out.clone(), url, ..PublishArgs::default() };
            publish_site(&args, &viewer).unwrap();
            fs::read_to_string(out.join("404.html")).unwrap()
        };
        let page = publish(&[&one], None);
        assert!(page.contains("There is no such page here") && page.contains("<a href=\"/\">"), "{page}");
        // A part of the site as all others: it is on its list, and replaced.
        let page = publish(&[&one, &other], Some("https://example.org/maps/"));
        assert!(page.contains("<a href=\"https://example.org/maps/\">Cities</a>"), "{page}");
        let list: serde_json::Value = serde_json::from_slice(&fs::read(out.join("insula-site.json")).unwrap()).unwrap();
        assert!(list["files"]["404.html"].is_string(), "{list}");
    }
}
