//! Another network, processor, screen or user than this machine has.

use super::Page;
use anyhow::Result;
use serde_json::{Value, json};

impl Page {
    /// A network of `mbit` megabits per second in each direction, whose responses begin after `rtt_ms`.
    pub fn emulate_network(&self, mbit: f64, rtt_ms: f64) -> Result<()> {
        let bytes_per_sec = mbit * 1e6 / 8.0;
        self.set_network(json!({
            "offline": false, "latency": rtt_ms,
            "downloadThroughput": bytes_per_sec, "uploadThroughput": bytes_per_sec,
        }))
    }

    /// No network, or the machine's own.
    pub fn set_offline(&self, is_offline: bool) -> Result<()> {
        self.set_network(json!({
            "offline": is_offline, "latency": 0, "downloadThroughput": -1, "uploadThroughput": -1,
        }))
    }

    fn set_network(&self, conditions: Value) -> Result<()> {
        self.log(|log| log.network = Some(conditions.clone()))?;
        self.call_everywhere("Network.emulateNetworkConditions", &conditions)
    }

    /// A processor that is slower by a factor.
    pub fn throttle_cpu(&self, rate: f64) -> Result<()> {
        let params = json!({ "rate": rate });
        self.log(|log| log.throttled = Some(params.clone()))?;
        self.call_everywhere("Emulation.setCPUThrottlingRate", &params)
    }

    /// Size in CSS pixels, and device pixels per CSS pixel. `is_mobile` adds touch input.
    pub fn set_viewport(&self, size: [u32; 2], ratio: f64, is_mobile: bool) -> Result<()> {
        let [width, height] = size;
        let metrics = json!({ "width": width, "height": height, "deviceScaleFactor": ratio, "mobile": is_mobile });
        self.call("Emulation.setDeviceMetricsOverride", metrics)?;
        let touch = match is_mobile {
            true => json!({ "enabled": true, "maxTouchPoints": 5 }),
            false => json!({ "enabled": false }),
        };
        self.call("Emulation.setTouchEmulationEnabled", touch).map(drop)
    }

    /// `dark` or `light`.
    pub fn set_media(&self, color_scheme: &str) -> Result<()> {
        let features = json!([{ "name": "prefers-color-scheme", "value": color_scheme }]);
        self.call("Emulation.setEmulatedMedia", json!({ "features": features })).map(drop)
    }

    /// Whether scripts of pages run.
    pub fn set_scripts(&self, run: bool) -> Result<()> {
        self.call("Emulation.setScriptExecutionDisabled", json!({ "value": !run })).map(drop)
    }
}
