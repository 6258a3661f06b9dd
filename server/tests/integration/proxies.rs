//! Pages behind proxies, which may have the server below a path, and at addresses that people mistype.

use crate::web_pages::{get, service, viewer};
use axum::http::StatusCode;
use insula_server::config::ServeConfig;
use insula_server::http::{AppState, HttpService};
use insula_server::store::Store;
use insula_test_support::small_city;

/// What browsers send with addresses that people type.
const HTML: &[(&str, &str)] = &[("accept", "text/html,*/*;q=0.8")];

#[tokio::test]
async fn a_proxy_may_have_the_server_below_a_path() {
    let folder = small_city::temporary_city();
    let config =
        ServeConfig { public_url: Some("https://example.org/maps/3d".parse().unwrap()), ..ServeConfig::default() };
    let state = AppState::with_viewer(Store::open(&[folder.path()]).unwrap(), &config, Some(viewer()));
    let service = HttpService::new(state);
    // The proxy takes its path out of the address, or leaves it.
    for path in ["/cities/two", "/maps/3d/cities/two"] {
        let page = get(&service, path, &[]).await;
        assert_eq!(page.status, StatusCode::OK, "{path}");
        for part in [
            "<link rel=\"canonical\" href=\"https://example.org/maps/3d/cities/two\">",
            "insula view https://example.org/maps/3d/v1/cities/two",
            "<insula-city src=\"../v1/cities/two\" full>",
        ] {
            assert!(page.text.contains(part), "{path} lacks {part}: {}", page.text);
        }
    }
    for path in
        ["/v1/cities/two", "/maps/3d/v1/cities/two", "/maps/3d/healthz", "/maps/3d/assets/00112233445566ff/app.js"]
    {
        assert_eq!(get(&service, path, &[]).await.status, StatusCode::OK, "{path}");
    }
    for path in ["/maps/3dv1/cities/two", "/maps/v1/cities/two", "/maps/3d/maps/3d/v1/cities/two"] {
        assert_eq!(get(&service, path, &[]).await.status, StatusCode::NOT_FOUND, "{path}");
    }
    for (path, meant) in [("/maps/3d", "/maps/3d/"), ("/maps/3d/cities/Two", "/maps/3d/cities/two")] {
        let page = get(&service, path, HTML).await;
        assert_eq!((page.status, page.header("location")), (StatusCode::PERMANENT_REDIRECT, meant));
    }
    let list = get(&service, "/v1/cities?limit=1", &[]).await;
    assert!(list.status == StatusCode::OK && list.text.contains("two"), "{}", list.text);
}

#[tokio::test]
async fn people_at_a_wrong_address_get_a_page() {
    let folder = small_city::temporary_city();
    let service = service(folder.path(), Some(viewer()));
    for (path, meant) in [
        ("/cities/Two", "../cities/two"),
        ("/cities/two/?share=x", "../../cities/two?share=x"),
        ("/CITIES/two", "../cities/two"),
        ("/cities/", "../"),
        ("/index.html", "./"),
    ] {
        let page = get(&service, path, HTML).await;
        assert_eq!((page.status, page.header("location")), (StatusCode::PERMANENT_REDIRECT, meant), "{path}");
        assert_eq!(page.header("cache-control"), "no-store");
    }
    for (path, root) in [("/cities/three", "../"), ("/maps", "./"), ("/a/b/c", "../../")] {
        let page = get(&service, path, HTML).await;
        assert_eq!(
            (page.status, page.header("content-type")),
            (StatusCode::NOT_FOUND, "text/html; charset=utf-8"),
            "{path}"
        );
        assert!(page.header("content-security-policy").contains("default-src 'none'"));
        assert!(page.text.contains(&format!("<a href=\"{root}\">Cities</a>")), "{path}: {}", page.text);
    }
    let german = get(&service, "/maps", &[("accept", "text/html"), ("accept-language", "de-AT, en;q=0.5")]).await;
    assert!(german.text.contains("lang=\"de\"") && german.text.contains(">Orte</a>"), "{}", german.text);
}
