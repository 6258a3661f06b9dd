//! Text in HTML.

use insula_protocol::manifest::Attribution;
use std::fmt::Write;

/// Text that can stand in elements and in quoted attributes.
pub(crate) fn escape_html(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '"' => out.push_str("&quot;"),
            '\'' => out.push_str("&#39;"),
            c => out.push(c),
        }
    }
    out
}

/// A source's text with its link and licence.
pub(super) fn credit(source: &Attribution) -> String {
    let mut text = escape_html(&source.text);
    // Other schemes, such as javascript:, must not become links.
    if let Some(url) = source.url.as_deref().filter(|url| url.starts_with("https://") || url.starts_with("http://")) {
        text = format!("<a href=\"{}\" rel=\"noopener noreferrer\">{text}</a>", escape_html(url));
    }
    if let Some(licence) = &source.licence {
        let _ = write!(text, " ({})", escape_html(licence));
    }
    text
}

/// JSON that can stand in a `<script>` element: nothing in it ends the element.
pub(super) fn script_json(json: &str) -> String {
    json.replace('<', "\\u003c")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_text_becomes_markup() {
        assert_eq!(escape_html("<a b=\"c\" d='e'>&"), "&lt;a b=&quot;c&quot; d=&#39;e&#39;&gt;&amp;");
        let hostile = serde_json::to_string("</script><script>alert(1)</script><!--").unwrap();
        let json = script_json(&hostile);
        assert!(!json.contains('<'));
        assert_eq!(serde_json::from_str::<String>(&json).unwrap(), "</script><script>alert(1)</script><!--");
    }

    #[test]
    fn only_web_addresses_become_links() {
        let with_url = |url: &str| {
            credit(&Attribution { text: "<b>".into(), licence: Some("\"L\"".into()), url: Some(url.into()) })
        };
        assert!(with_url("https://x/\"onclick=").starts_with("<a href=\"https://x/&quot;onclick=\" rel"));
        assert_eq!(with_url("javascript:alert(1)"), "&lt;b&gt; (&quot;L&quot;)");
    }
}
