//! The objects of a city in a browser.
//!
//! A module apart from the viewer's, because a page shows the city before it is asked about its objects. `page/engine-core.js` fetches it
//! then, and passes styles on to the viewer.

#[cfg(target_arch = "wasm32")]
pub mod reader;
