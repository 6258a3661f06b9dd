//! Keys and what they do.

use insula_shaders::layout::Shading;
use insula_viewer::interaction::camera_control::MoveDirection;
use winit::keyboard::{Key, KeyCode};

/// Action of a key.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum KeyAction {
    /// Move while the key is held.
    Move(MoveDirection),
    /// End what Escape ends. It never quits.
    EndInnermost,
    Quit,
    /// Switch between flying and orbiting.
    ToggleMode,
    /// Go back to the first view.
    GoHome,
    TurnNorth,
    /// Let ground and buildings stop the camera, or not.
    ToggleCollision,
    ToggleHelp,
    SaveImage,
    SetShading(Shading),
    ToggleFullScreen,
    AddBookmark,
    /// Show or hide bookmarks and coordinates.
    ToggleBookmarks,
    /// Copy a view link.
    CopyLink,
    /// Start or stop recording a camera path.
    ToggleRecording,
    /// Start or stop measuring.
    ToggleMeasuring,
    /// Remove the last measured point.
    UndoPoint,
    /// Run or pause the time of day.
    ToggleDay,
    ToggleMap,
    /// Show or hide the search box.
    ToggleSearch,
    /// Show or hide colours and filter of objects.
    ToggleStyles,
    /// Show or hide the sliders of stones.
    ToggleStones,
    /// Show or hide the sliders.
    ToggleSliders,
    /// Show or hide the developer counters.
    ToggleCounters,
    /// Start or stop counting ray steps.
    ToggleRayCounts,
    ToggleShadows,
}

/// Lines of the help panel: keys, and what they do.
pub const HELP: [(&str, &str); 31] = [
    ("drag", "look around (fly and walk mode), turn around the point ahead (orbit mode)"),
    ("W A S D, arrows", "move; with Shift, four times as fast"),
    ("Q E, Page Down and Up", "move down and up"),
    ("wheel", "speed (fly mode), distance (orbit mode)"),
    ("touchpad", "two fingers: like the wheel, or turn; pinch: closer; rotate: turn"),
    ("click, Shift click", "select an object and show its attributes; add one to the selection"),
    ("/", "search names, addresses and identifiers"),
    ("G", "colours and filter of objects by their attributes"),
    ("J", "stones of landmarks, with sliders"),
    ("double click", "go to this place"),
    ("H, U", "back to the first view, north up"),
    ("X", "stop at buildings and the ground, or not; on in walk mode"),
    ("F", "fly mode, walk mode or orbit mode"),
    ("1 to 9", "light, colour, ambient occlusion, normals, levels, column kinds, edges of triangles, triangles, boxes"),
    ("B", "bookmark this view"),
    ("V", "bookmarks and coordinates"),
    ("C", "copy a link to this view"),
    ("M", "measure lines, then areas, then heights by clicks"),
    ("Backspace, Ctrl Z", "remove the last measured point"),
    ("N", "map; click it to go there"),
    ("R", "start or stop recording a path for insula fly"),
    ("P", "save a picture in the current folder, at the size of panel O"),
    ("O", "panel of light, detail and pictures"),
    ("T", "run or pause the time of day"),
    ("I", "developer counters"),
    ("L", "sun shadows on or off"),
    ("K", "count ray steps when the view rests"),
    ("F11", "full screen"),
    ("F1", "this help"),
    ("Esc", "close a panel, end measuring, deselect, cancel a picture, leave full screen"),
    ("Ctrl Q", "quit"),
];

/// The keys of the letters A to Z.
const LETTERS: [KeyCode; 26] = [
    KeyCode::KeyA,
    KeyCode::KeyB,
    KeyCode::KeyC,
    KeyCode::KeyD,
    KeyCode::KeyE,
    KeyCode::KeyF,
    KeyCode::KeyG,
    KeyCode::KeyH,
    KeyCode::KeyI,
    KeyCode::KeyJ,
    KeyCode::KeyK,
    KeyCode::KeyL,
    KeyCode::KeyM,
    KeyCode::KeyN,
    KeyCode::KeyO,
    KeyCode::KeyP,
    KeyCode::KeyQ,
    KeyCode::KeyR,
    KeyCode::KeyS,
    KeyCode::KeyT,
    KeyCode::KeyU,
    KeyCode::KeyV,
    KeyCode::KeyW,
    KeyCode::KeyX,
    KeyCode::KeyY,
    KeyCode::KeyZ,
];

/// The key that was meant: what moves the camera is where it lies on every keyboard, other letters and the slash are what is
/// written on them. Where no letters are Latin, they are where they lie, too.
pub fn code_of(lies_at: KeyCode, written: &Key, is_ctrl_down: bool) -> KeyCode {
    let Key::Character(text) = written else { return lies_at };
    if matches!(action_of(lies_at, is_ctrl_down), Some(KeyAction::Move(_))) {
        return lies_at;
    }
    match text.as_bytes() {
        b"/" => KeyCode::Slash,
        [letter] if letter.is_ascii_alphabetic() => LETTERS[usize::from(letter.to_ascii_lowercase() - b'a')],
        _ => lies_at,
    }
}

/// The action of a key, if it has one. The page in browsers has the same keys, which `key-table.js` lists.
pub fn action_of(code: KeyCode, is_ctrl_down: bool) -> Option<KeyAction> {
    if is_ctrl_down {
        return match code {
            KeyCode::KeyQ => Some(KeyAction::Quit),
            KeyCode::KeyZ => Some(KeyAction::UndoPoint),
            _ => None,
        };
    }
    Some(match code {
        KeyCode::KeyW | KeyCode::ArrowUp => KeyAction::Move(MoveDirection::Forward),
        KeyCode::KeyS | KeyCode::ArrowDown => KeyAction::Move(MoveDirection::Back),
        KeyCode::KeyA | KeyCode::ArrowLeft => KeyAction::Move(MoveDirection::Left),
        KeyCode::KeyD | KeyCode::ArrowRight => KeyAction::Move(MoveDirection::Right),
        KeyCode::KeyE | KeyCode::PageUp => KeyAction::Move(MoveDirection::Up),
        KeyCode::KeyQ | KeyCode::PageDown => KeyAction::Move(MoveDirection::Down),
        KeyCode::Escape => KeyAction::EndInnermost,
        KeyCode::KeyF => KeyAction::ToggleMode,
        KeyCode::KeyH | KeyCode::Home => KeyAction::GoHome,
        KeyCode::KeyU => KeyAction::TurnNorth,
        KeyCode::KeyX => KeyAction::ToggleCollision,
        KeyCode::F1 => KeyAction::ToggleHelp,
        KeyCode::F11 => KeyAction::ToggleFullScreen,
        KeyCode::KeyP => KeyAction::SaveImage,
        KeyCode::KeyB => KeyAction::AddBookmark,
        KeyCode::KeyV => KeyAction::ToggleBookmarks,
        KeyCode::KeyC => KeyAction::CopyLink,
        KeyCode::KeyR => KeyAction::ToggleRecording,
        KeyCode::KeyM => KeyAction::ToggleMeasuring,
        KeyCode::KeyN => KeyAction::ToggleMap,
        KeyCode::Slash => KeyAction::ToggleSearch,
        KeyCode::KeyG => KeyAction::ToggleStyles,
        KeyCode::KeyJ => KeyAction::ToggleStones,
        KeyCode::Backspace => KeyAction::UndoPoint,
        KeyCode::KeyT => KeyAction::ToggleDay,
        KeyCode::KeyO => KeyAction::ToggleSliders,
        KeyCode::KeyI => KeyAction::ToggleCounters,
        KeyCode::KeyK => KeyAction::ToggleRayCounts,
        KeyCode::KeyL => KeyAction::ToggleShadows,
        KeyCode::Digit1 => KeyAction::SetShading(Shading::ALL[0]),
        KeyCode::Digit2 => KeyAction::SetShading(Shading::ALL[1]),
        KeyCode::Digit3 => KeyAction::SetShading(Shading::ALL[2]),
        KeyCode::Digit4 => KeyAction::SetShading(Shading::ALL[3]),
        KeyCode::Digit5 => KeyAction::SetShading(Shading::ALL[4]),
        KeyCode::Digit6 => KeyAction::SetShading(Shading::ALL[5]),
        KeyCode::Digit7 => KeyAction::SetShading(Shading::ALL[6]),
        KeyCode::Digit8 => KeyAction::SetShading(Shading::ALL[7]),
        KeyCode::Digit9 => KeyAction::SetShading(Shading::ALL[8]),
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn escape_never_quits() {
        assert_eq!(action_of(KeyCode::Escape, false), Some(KeyAction::EndInnermost));
        assert_eq!(action_of(KeyCode::Escape, true), None);
        assert_eq!(action_of(KeyCode::KeyQ, true), Some(KeyAction::Quit));
    }

    #[test]
    fn keys_are_what_is_written_on_them() {
        let code =
            |lies_at, written: &str, is_ctrl_down| code_of(lies_at, &Key::Character(written.into()), is_ctrl_down);
        // German.
        assert_eq!(code(KeyCode::KeyY, "z", true), KeyCode::KeyZ);
        assert_eq!(code(KeyCode::Digit7, "/", false), KeyCode::Slash);
        // French: what quits on an American keyboard, and what moves forward there.
        assert_eq!(code(KeyCode::KeyQ, "a", true), KeyCode::KeyA);
        assert_eq!(code(KeyCode::KeyW, "z", false), KeyCode::KeyW);
        assert_eq!(code(KeyCode::Semicolon, "M", false), KeyCode::KeyM);
        // Russian.
        assert_eq!(code(KeyCode::KeyM, "\u{44c}", false), KeyCode::KeyM);
        assert_eq!(code_of(KeyCode::F1, &Key::Dead(None), false), KeyCode::F1);
    }

    /// The page names its keys by the same codes.
    #[test]
    fn keys_of_the_page_do_the_same() {
        let table = include_str!("../../web/page/key-table.js");
        let same = [
            ("KeyF: 'mode'", KeyCode::KeyF, KeyAction::ToggleMode),
            ("KeyH: 'home'", KeyCode::KeyH, KeyAction::GoHome),
            ("KeyU: 'north'", KeyCode::KeyU, KeyAction::TurnNorth),
            ("KeyX: 'collision'", KeyCode::KeyX, KeyAction::ToggleCollision),
            ("KeyL: 'shadows'", KeyCode::KeyL, KeyAction::ToggleShadows),
            ("KeyT: 'day'", KeyCode::KeyT, KeyAction::ToggleDay),
            ("KeyB: 'bookmark'", KeyCode::KeyB, KeyAction::AddBookmark),
            ("KeyC: 'copyLink'", KeyCode::KeyC, KeyAction::CopyLink),
            ("KeyG: 'colors'", KeyCode::KeyG, KeyAction::ToggleStyles),
            ("KeyI: 'counters'", KeyCode::KeyI, KeyAction::ToggleCounters),
            ("KeyM: 'measure'", KeyCode::KeyM, KeyAction::ToggleMeasuring),
            ("KeyO: 'time'", KeyCode::KeyO, KeyAction::ToggleSliders),
            ("KeyP: 'picture'", KeyCode::KeyP, KeyAction::SaveImage),
            ("KeyV: 'bookmarks'", KeyCode::KeyV, KeyAction::ToggleBookmarks),
            ("Slash: 'search'", KeyCode::Slash, KeyAction::ToggleSearch),
            ("Backspace: 'undo'", KeyCode::Backspace, KeyAction::UndoPoint),
            ("F1: 'help'", KeyCode::F1, KeyAction::ToggleHelp),
            ("Escape: 'escape'", KeyCode::Escape, KeyAction::EndInnermost),
        ];
        for (line, code, action) in same {
            assert!(table.contains(line), "the page has another key than {line}");
            assert_eq!(action_of(code, false), Some(action), "{line}");
        }
    }
}
