//! The link of another host's live page.

use axum::http::Uri;
use erfgs_page::access::Token;

use super::error::LinkError;

/// Port of a link that names none.
const PORT: u16 = 80;

/// Where another host's recorder answers, and the token that it asks for.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct HostLink {
    host: String,
    port: u16,
    token: Option<Token>,
}

impl HostLink {
    /// Reads a link as a recorder prints it: `http://HOST:PORT/?token=TOKEN`.
    ///
    /// # Errors
    /// If it is none. The message leaves out what follows the `?`, which is secret.
    pub fn parse(text: &str) -> Result<Self, LinkError> {
        let text = text.trim();
        let shown = || text.split('?').next().unwrap_or_default().to_owned();
        let wrong = |why| LinkError::Wrong { link: shown(), why };
        let uri: Uri = text.parse().map_err(|_| wrong("it is no address"))?;
        match uri.scheme_str() {
            Some("http") => {}
            Some("https") => return Err(wrong("live pages speak plain http")),
            _ => return Err(wrong("it does not begin with http://")),
        }
        let authority = uri.authority().ok_or_else(|| wrong("it names no host"))?;
        if authority.as_str().contains('@') {
            return Err(LinkError::Wrong { link: "http://…@…".into(), why: "a live page has no user names" });
        }
        if !matches!(uri.path(), "" | "/") {
            return Err(wrong("it has a path behind the host: give the address of the page itself"));
        }
        let host = authority.host().to_owned();
        if matches!(host.as_str(), "0.0.0.0" | "[::]") {
            return Err(LinkError::Unspecified { link: shown() });
        }
        if host.is_empty() {
            return Err(wrong("it names no host"));
        }
        let port = match authority.as_str().strip_prefix(host.as_str()).and_then(|rest| rest.strip_prefix(':')) {
            None => PORT,
            Some(port) => port
                .parse()
                .ok()
                .filter(|port| *port > 0)
                .ok_or_else(|| wrong("its port is not a number from 1 to 65535"))?,
        };
        let query = uri.query().unwrap_or_default();
        let token = query.split('&').find_map(|part| part.strip_prefix("token="));
        let token = token.map(|token| Token::given(token).ok_or_else(|| wrong("its token is incomplete")));
        Ok(Self { host, port, token: token.transpose()? })
    }

    /// `HOST:PORT`, as which the host is told of.
    #[must_use]
    pub fn name(&self) -> String {
        format!("{}:{}", self.host, self.port)
    }

    /// The host without its port.
    #[must_use]
    pub fn host(&self) -> &str {
        &self.host
    }

    /// What the system is asked for: an IPv6 address without its brackets.
    pub(super) fn to_connect(&self) -> (&str, u16) {
        (self.host.trim_start_matches('[').trim_end_matches(']'), self.port)
    }

    /// The secret that is sent along.
    pub(super) fn token(&self) -> Option<&Token> {
        self.token.as_ref()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TOKEN: &str = "0123456789abcdef0123456789abcdef";

    #[test]
    fn links_are_read_as_recorders_print_them() {
        for (text, name, host) in [
            (format!("http://10.0.0.2:8100/?token={TOKEN}"), "10.0.0.2:8100", "10.0.0.2"),
            (format!(" http://eye.lab:81?x=1&token={TOKEN}\n"), "eye.lab:81", "eye.lab"),
            (format!("http://[fe80::1]/?token={TOKEN}"), "[fe80::1]:80", "fe80::1"),
        ] {
            let link = HostLink::parse(&text).unwrap();
            assert_eq!((link.name().as_str(), link.to_connect().0), (name, host), "{text}");
            assert!(link.token().unwrap().is(TOKEN));
        }
        assert!(HostLink::parse("http://127.0.0.1:8100/").unwrap().token().is_none());
    }

    #[test]
    fn what_is_no_link_is_refused_without_telling_the_secret() {
        for text in [
            "",
            "10.0.0.2:8100",
            "https://10.0.0.2:8100/?token=0123456789abcdef0123456789abcdef",
            "http://0.0.0.0:8100/?token=0123456789abcdef0123456789abcdef",
            "http://[::]:8100/?token=0123456789abcdef0123456789abcdef",
            "http://10.0.0.2:8100/?token=0123456789abcdef",
            "http://10.0.0.2:8100/?token=0123456789abcdef0123456789abcdeX",
            "http://10.0.0.2:8100/api/status?token=0123456789abcdef0123456789abcdef",
            "http://me:0123456789abcdef@10.0.0.2:8100/",
            "http://:8100/?token=0123456789abcdef0123456789abcdef",
            "http://10.0.0.2:81000/",
            "file:///etc/passwd",
        ] {
            let refused = HostLink::parse(text).expect_err(text);
            for message in [refused.to_string(), format!("{refused:?}")] {
                assert!(!message.contains("0123456789abcdef"), "{message}");
            }
        }
        let shown = format!("{:?}", HostLink::parse(&format!("http://a:1/?token={TOKEN}")).unwrap());
        assert!(!shown.contains(TOKEN), "{shown}");
    }
}
