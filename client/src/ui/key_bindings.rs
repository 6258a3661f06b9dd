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
    /// Move along the view.
    Closer,
    Farther,
    /// Click in the middle of the window.
    ClickMiddle,
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
    CopyLink,
    /// Start or stop recording a camera path.
    ToggleRecording,
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
    /// Show the city with the proposal, or as it is.
    ToggleProposal,
    ToggleSliders,
    /// Show or hide the developer counters.
    ToggleCounters,
    /// Start or stop counting ray steps.
    ToggleRayCounts,
    ToggleShadows,
}

/// Lines of the help panel: keys, and what they do.
pub const HELP: [(&str, &str); 34] = [
    ("drag", "look around (fly and walk mode), turn around the point ahead (orbit mode)"),
    ("W A S D, arrows", "move; with Shift, four times as fast"),
    ("Q E, Page Down and Up", "move down and up"),
    ("wheel", "speed (fly mode), distance (orbit mode)"),
    ("+ -", "closer, farther"),
    ("touchpad", "two fingers: like the wheel, or turn; pinch: closer; rotate: turn"),
    ("Enter", "click in the middle of the window"),
    ("click, Shift click", "select an object and show its attributes; add one to the selection"),
    ("/", "search names, addresses and identifiers"),
    ("G", "colours and filter of objects by their attributes"),
    ("J", "stones of landmarks, with sliders"),
    ("Y", "with a proposal: the city before and after"),
    ("double click", "go to this place"),
    ("H, U", "back to the first view, north up"),
    ("X", "stop at buildings and the ground, or not; on in walk mode"),
    ("F", "fly mode, walk mode or orbit mode"),
    ("B", "bookmark this view"),
    ("V", "bookmarks, going to coordinates, camera file"),
    ("C", "copy a link to this view, or its camera if the city is a folder"),
    ("M", "measure lines, then areas, then heights by clicks"),
    ("Backspace, Ctrl Z", "remove the last measured point"),
    ("N", "map; click it to go there"),
    ("R", "start or stop recording a path for insula fly"),
    ("P", "save a picture in the current folder, at the size of panel O"),
    ("O", "panel of light, detail and pictures"),
    ("T", "run or pause the time of day"),
    ("L", "sun shadows on or off"),
    ("F11", "full screen"),
    ("F1", "this help"),
    ("Esc", "close a panel, end measuring, deselect, cancel a picture, leave full screen"),
    ("Ctrl Q", "quit"),
    ("", "For developers"),
    ("1 to 9", "light, colour, ambient occlusion, normals, levels, column kinds, edges of triangles, triangles, boxes"),
    ("I, K", "counters; count ray steps when the view rests"),
];

/// The keys of the letters A to Z.
const LETTERS: [KeyCode; 26] = {
    use KeyCode::*;
    [
        KeyA, KeyB, KeyC, KeyD, KeyE, KeyF, KeyG, KeyH, KeyI, KeyJ, KeyK, KeyL, KeyM, KeyN, KeyO, KeyP, KeyQ, KeyR,
        KeyS, KeyT, KeyU, KeyV, KeyW, KeyX, KeyY, KeyZ,
    ]
};
/// The keys of the shadings, in their order.
const DIGITS: [KeyCode; 9] = {
    use KeyCode::*;
    [Digit1, Digit2, Digit3, Digit4, Digit5, Digit6, Digit7, Digit8, Digit9]
};

/// The key that was meant: what moves the camera is where it lies on every keyboard, other letters and the slash are what is
/// written on them. Where no letters are Latin, they are where they lie, too.
pub fn code_of(lies_at: KeyCode, written: &Key, is_ctrl_down: bool) -> KeyCode {
    let Key::Character(text) = written else { return lies_at };
    if matches!(action_of(lies_at, is_ctrl_down), Some(KeyAction::Move(_))) {
        return lies_at;
    }
    match text.as_bytes() {
        b"/" => KeyCode::Slash,
        b"?" => KeyCode::F1,
        b"+" => KeyCode::Equal,
        b"-" => KeyCode::Minus,
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
        KeyCode::Equal | KeyCode::NumpadAdd => KeyAction::Closer,
        KeyCode::Minus | KeyCode::NumpadSubtract => KeyAction::Farther,
        KeyCode::Enter => KeyAction::ClickMiddle,
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
        KeyCode::KeyY => KeyAction::ToggleProposal,
        KeyCode::Backspace => KeyAction::UndoPoint,
        KeyCode::KeyT => KeyAction::ToggleDay,
        KeyCode::KeyO => KeyAction::ToggleSliders,
        KeyCode::KeyI => KeyAction::ToggleCounters,
        KeyCode::KeyK => KeyAction::ToggleRayCounts,
        KeyCode::KeyL => KeyAction::ToggleShadows,
        _ => {
            let number = DIGITS.iter().position(|digit| *digit == code)?;
            KeyAction::SetShading(Shading::ALL[number])
        }
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
        assert_eq!(code(KeyCode::Slash, "-", false), KeyCode::Minus);
        // American.
        assert_eq!(code(KeyCode::Slash, "?", false), KeyCode::F1);
        // French: what quits on an American keyboard, and what moves forward there.
        assert_eq!(code(KeyCode::KeyQ, "a", true), KeyCode::KeyA);
        assert_eq!(code(KeyCode::KeyW, "z", false), KeyCode::KeyW);
        assert_eq!(code(KeyCode::Semicolon, "M", false), KeyCode::KeyM);
        // Russian.
        assert_eq!(code(KeyCode::KeyM, "\u{44c}", false), KeyCode::KeyM);
        assert_eq!(code_of(KeyCode::F1, &Key::Dead(None), false), KeyCode::F1);
    }

    /// The page names its keys by the same codes. Each side may have keys that the other has no use for.
    #[test]
    fn keys_of_the_page_do_the_same() {
        const SAME: [(&str, KeyAction); 22] = [
            ("closer", KeyAction::Closer),
            ("farther", KeyAction::Farther),
            ("middle", KeyAction::ClickMiddle),
            ("mode", KeyAction::ToggleMode),
            ("home", KeyAction::GoHome),
            ("north", KeyAction::TurnNorth),
            ("collision", KeyAction::ToggleCollision),
            ("shadows", KeyAction::ToggleShadows),
            ("day", KeyAction::ToggleDay),
            ("bookmark", KeyAction::AddBookmark),
            ("copyLink", KeyAction::CopyLink),
            ("colors", KeyAction::ToggleStyles),
            ("counters", KeyAction::ToggleCounters),
            ("measure", KeyAction::ToggleMeasuring),
            ("time", KeyAction::ToggleSliders),
            ("picture", KeyAction::SaveImage),
            ("bookmarks", KeyAction::ToggleBookmarks),
            ("proposal", KeyAction::ToggleProposal),
            ("search", KeyAction::ToggleSearch),
            ("undo", KeyAction::UndoPoint),
            ("help", KeyAction::ToggleHelp),
            ("escape", KeyAction::EndInnermost),
        ];
        // Stones, the map, paths, counts of rays and full screen: the page has no such panels, or the browser has the key.
        const ONLY_HERE: [KeyCode; 5] = [KeyCode::KeyJ, KeyCode::KeyN, KeyCode::KeyR, KeyCode::KeyK, KeyCode::F11];
        let table = include_str!("../../web/page/key-table.js");
        let (_, actions) = table.split_once("VIEW_KEYS").unwrap();
        let of_page: std::collections::BTreeMap<&str, &str> = actions
            .lines()
            .filter_map(|line| line.trim().strip_suffix("',")?.split_once(": '"))
            .filter(|(code, _)| code.chars().all(char::is_alphanumeric))
            .collect();
        let codes: Vec<KeyCode> = LETTERS
            .into_iter()
            .chain([KeyCode::Equal, KeyCode::NumpadAdd, KeyCode::Minus, KeyCode::NumpadSubtract, KeyCode::Enter])
            .chain([KeyCode::Home, KeyCode::Slash, KeyCode::Backspace, KeyCode::F1, KeyCode::F11, KeyCode::Escape])
            .collect();
        for name in of_page.keys() {
            assert!(codes.iter().any(|code| format!("{code:?}") == **name), "this test knows no key {name}");
        }
        for code in codes {
            // The page takes Z with Ctrl only.
            let action = action_of(code, code == KeyCode::KeyZ);
            let is_move = matches!(action, Some(KeyAction::Move(_)));
            let page = of_page.get(format!("{code:?}").as_str());
            let expected = page.map(|page| SAME.iter().find(|(name, _)| name == page).expect(page).1);
            if !is_move && !ONLY_HERE.contains(&code) {
                assert_eq!(action, expected, "{code:?}");
            }
        }
    }
}
