//! Everything that the client fetches: opens cities, and fetches and decodes their tiles on background threads.

mod background_fetcher;
pub mod city;
pub mod fetch;
pub(crate) mod jitter;
pub mod location;
pub mod notifier;
pub mod simulated_link;
pub mod source;

pub use background_fetcher::{BackgroundFetcher, Wake};
