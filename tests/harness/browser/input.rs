//! Mouse, keyboard and touch, as a user gives them.

use super::Page;
use anyhow::{Context, Result};
use serde_json::{Value, json};
use std::sync::atomic::Ordering::Relaxed;
use std::time::{Duration, SystemTime, UNIX_EPOCH};

/// Moves of a drag. The browser answers after the page has handled one, so they are not merged.
const STEPS: u32 = 8;
/// Milliseconds from press to release, between the clicks of a double click, and between others.
const PRESS_MS: u64 = 10;
const DOUBLE_CLICK_MS: u64 = 100;
const APART_MS: u64 = 2000;

#[derive(Debug, Clone, Copy)]
pub enum Button {
    Left,
    Middle,
    Right,
}

impl Button {
    fn name(self) -> &'static str {
        match self {
            Self::Left => "left",
            Self::Middle => "middle",
            Self::Right => "right",
        }
    }
}

impl Page {
    fn mouse(&self, kind: &str, at: [f64; 2], more: &Value) -> Result<()> {
        let mut params = json!({ "type": kind, "x": at[0], "y": at[1] });
        for (name, value) in more.as_object().into_iter().flatten() {
            params[name] = value.clone();
        }
        self.call("Input.dispatchMouseEvent", params).map(drop)
    }

    /// Moves the mouse to a place without a pressed button.
    pub fn point_at(&self, at: [f64; 2]) -> Result<()> {
        self.mouse("mouseMoved", at, &json!({}))
    }

    /// Clicks `count` times: 2 is a double click, and two calls are none. The page sees such times, however fast the machine is.
    pub fn click(&self, at: [f64; 2], count: u32) -> Result<()> {
        self.mouse("mouseMoved", at, &Value::Null)?;
        let now_ms = SystemTime::now().duration_since(UNIX_EPOCH)?.as_millis() as u64;
        let mut time_ms = now_ms.max(self.clicked_ms.load(Relaxed) + APART_MS);
        for click in 1..=count {
            for (kind, after_ms) in [("mousePressed", 0), ("mouseReleased", PRESS_MS)] {
                let time_s = (time_ms + after_ms) as f64 / 1000.0;
                let button = json!({ "button": "left", "clickCount": click, "timestamp": time_s });
                self.mouse(kind, at, &button)?;
            }
            time_ms += DOUBLE_CLICK_MS;
        }
        self.clicked_ms.store(time_ms, Relaxed);
        Ok(())
    }

    pub fn drag(&self, button: Button, from: [f64; 2], to: [f64; 2]) -> Result<()> {
        let held = json!({ "button": button.name(), "clickCount": 1 });
        self.mouse("mouseMoved", from, &Value::Null)?;
        self.mouse("mousePressed", from, &held)?;
        for step in 1..=STEPS {
            self.mouse("mouseMoved", between(from, to, step), &held)?;
        }
        self.mouse("mouseReleased", to, &held)
    }

    /// Turns the wheel; a positive number scrolls down.
    pub fn wheel(&self, at: [f64; 2], pixels: f64) -> Result<()> {
        self.mouse("mouseWheel", at, &json!({ "deltaX": 0, "deltaY": pixels }))
    }

    /// Moves fingers, each from one place to another, and lifts them.
    pub fn touch(&self, fingers: &[[[f64; 2]; 2]]) -> Result<()> {
        let points = |step: u32| -> Vec<Value> {
            let at = fingers.iter().map(|[from, to]| between(*from, *to, step)).enumerate();
            at.map(|(id, [x, y])| json!({ "id": id, "x": x, "y": y })).collect()
        };
        let send = |kind: &str, points: Vec<Value>| {
            self.call("Input.dispatchTouchEvent", json!({ "type": kind, "touchPoints": points })).map(drop)
        };
        send("touchStart", points(0))?;
        for step in 1..=STEPS {
            send("touchMove", points(step))?;
        }
        send("touchEnd", Vec::new())
    }

    /// Presses a key: a letter, a digit, or a name such as `ArrowUp`.
    pub fn key_down(&self, key: &str) -> Result<()> {
        let mut params = key_params(key)?;
        params["type"] = "keyDown".into();
        self.call("Input.dispatchKeyEvent", params).map(drop)
    }

    pub fn key_up(&self, key: &str) -> Result<()> {
        let mut params = key_params(key)?;
        params["type"] = "keyUp".into();
        params["text"] = "".into();
        self.call("Input.dispatchKeyEvent", params).map(drop)
    }

    /// Presses and releases a key.
    pub fn press(&self, key: &str) -> Result<()> {
        self.key_down(key)?;
        self.key_up(key)
    }

    /// Holds a key for a time.
    pub fn hold(&self, key: &str, time: Duration) -> Result<()> {
        self.key_down(key)?;
        std::thread::sleep(time);
        self.key_up(key)
    }
}

fn between(from: [f64; 2], to: [f64; 2], step: u32) -> [f64; 2] {
    let part = f64::from(step) / f64::from(STEPS);
    [0, 1].map(|k| from[k] + (to[k] - from[k]) * part)
}

/// What the browser needs to know of a key on an American keyboard.
fn key_params(key: &str) -> Result<Value> {
    let named = [
        ("ArrowLeft", 37, ""),
        ("ArrowUp", 38, ""),
        ("ArrowRight", 39, ""),
        ("ArrowDown", 40, ""),
        ("PageUp", 33, ""),
        ("PageDown", 34, ""),
        ("End", 35, ""),
        ("Home", 36, ""),
        ("Escape", 27, ""),
        ("Tab", 9, ""),
        ("Delete", 46, ""),
        ("Backspace", 8, ""),
        ("Enter", 13, "\r"),
    ];
    if let Some((name, number, text)) = named.into_iter().find(|(name, ..)| *name == key) {
        return Ok(json!({ "key": name, "code": name, "windowsVirtualKeyCode": number, "text": text }));
    }
    let letter = key.chars().next().filter(|_| key.chars().count() == 1).with_context(|| format!("no key {key:?}"))?;
    let upper = letter.to_ascii_uppercase();
    let code = match upper {
        'A'..='Z' => format!("Key{upper}"),
        '0'..='9' => format!("Digit{upper}"),
        ' ' => "Space".to_owned(),
        '/' | '?' => "Slash".to_owned(),
        '-' => "Minus".to_owned(),
        '+' | '=' => "Equal".to_owned(),
        _ => String::new(),
    };
    Ok(json!({ "key": key, "code": code, "windowsVirtualKeyCode": upper as u32, "text": key }))
}
