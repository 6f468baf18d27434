//! Who may see a page that is served: this machine alone, or who knows the token; and only under an address that cannot be
//! another site's name.

use std::{
    net::{IpAddr, SocketAddr},
    sync::Arc,
};

use axum::{
    extract::{Request, State},
    http::{HeaderMap, HeaderName, HeaderValue, Method, StatusCode, header},
    middleware::Next,
    response::{IntoResponse, Response},
};

use crate::serve::{PageError, PageOptions};

/// Beginning of the name of the cookie that carries the token. The port follows: browsers tell hosts apart by cookies, not
/// ports, and there may be a page at another one.
const COOKIE: &str = "erfgs_token_";

/// The name of the cookie of the page that is called `host`.
fn cookie_of(host: &str) -> String {
    let port = host.rsplit_once(':').map_or("", |(_, port)| port);
    let port = if port.bytes().all(|byte| byte.is_ascii_digit()) && !port.is_empty() { port } else { "80" };
    format!("{COOKIE}{port}")
}

/// A random secret of 128 bits, as 32 hexadecimal digits.
#[derive(Clone, PartialEq, Eq)]
pub struct Token(String);

impl std::fmt::Debug for Token {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter.write_str("Token(..)")
    }
}

impl Token {
    /// Draws one from the system's source of randomness.
    ///
    /// # Errors
    /// If the system has none.
    pub fn random() -> Result<Self, getrandom::Error> {
        let mut bytes = [0; 16];
        getrandom::fill(&mut bytes)?;
        Ok(Self(bytes.iter().map(|byte| format!("{byte:02x}")).collect()))
    }

    /// One that somebody else drew, in its digits.
    #[must_use]
    pub fn given(digits: &str) -> Option<Self> {
        let whole = digits.len() == 32 && digits.bytes().all(|byte| byte.is_ascii_hexdigit());
        whole.then(|| Self(digits.to_owned()))
    }

    /// The digits.
    #[must_use]
    pub fn reveal(&self) -> &str {
        &self.0
    }

    /// Compares in a time that tells nothing about where two tokens differ.
    #[must_use]
    pub fn is(&self, other: &str) -> bool {
        let (own, other) = (self.0.as_bytes(), other.as_bytes());
        own.len() == other.len() && own.iter().zip(other).fold(0, |different, (a, b)| different | (a ^ b)) == 0
    }
}

/// The rules of one server.
#[derive(Clone, Debug)]
pub struct Access {
    /// The secret; `None` where every user of this machine may see the page.
    pub token: Option<Token>,
    /// Names that the server may be called by, besides `localhost` and bare addresses.
    pub names: Vec<String>,
}

impl Access {
    /// The rules for a server: who knows the token of its link, unless it is open to all users of this machine.
    ///
    /// # Errors
    /// [`PageError::Open`] if it would be open to the network, [`PageError::Token`] if no token can be drawn.
    pub fn new(options: &PageOptions) -> Result<Self, PageError> {
        let PageOptions { address, names, open } = options;
        if *open && !address.ip().is_loopback() {
            return Err(PageError::Open { address: *address });
        }
        let token = if *open { None } else { Some(Token::random().map_err(PageError::Token)?) };
        Ok(Self { token, names: names.clone() })
    }

    /// The address to open of a server at `address`, with the token where one is needed.
    #[must_use]
    pub fn url(&self, address: SocketAddr) -> String {
        match &self.token {
            Some(token) => format!("http://{address}/?token={}", token.reveal()),
            None => format!("http://{address}/"),
        }
    }

    /// Whether a request may pass: `query` is what follows the `?` of its address.
    ///
    /// # Errors
    /// With the status and the reason to answer.
    pub fn check(&self, method: &Method, headers: &HeaderMap, query: &str) -> Result<(), (StatusCode, &'static str)> {
        let text = |name| headers.get(name).and_then(|value| value.to_str().ok());
        let host = text(header::HOST).ok_or((StatusCode::BAD_REQUEST, "the request names no host"))?;
        // A page of another site whose name was made to point here would be called by that name.
        if !self.is_ours(host) {
            return Err((
                StatusCode::FORBIDDEN,
                "this server is not called by that name: use its address, or allow the name with --live-name",
            ));
        }
        // Browsers send the origin with everything that another site's page asks for and that changes something.
        if let Some(origin) = text(header::ORIGIN)
            && (method != Method::GET || origin != "null")
            && origin.strip_prefix("http://") != Some(host)
        {
            return Err((StatusCode::FORBIDDEN, "another site asks: refused"));
        }
        let Some(token) = &self.token else { return Ok(()) };
        let cookie = cookie_of(host);
        let offered = [
            parameter(query, "token"),
            text(header::AUTHORIZATION).and_then(|value| value.strip_prefix("Bearer ")),
            text(header::COOKIE).and_then(|value| {
                value.split(';').find_map(|part| part.trim().strip_prefix(cookie.as_str())?.strip_prefix('='))
            }),
        ];
        if offered.into_iter().flatten().any(|offered| token.is(offered)) {
            return Ok(());
        }
        Err((StatusCode::UNAUTHORIZED, "open the page by the address with the token that erfgs printed"))
    }

    fn is_ours(&self, host: &str) -> bool {
        let name = match host.strip_prefix('[') {
            Some(rest) => rest.split(']').next().unwrap_or_default(),
            None => host.rsplit_once(':').map_or(host, |(name, _)| name),
        };
        name.parse::<IpAddr>().is_ok()
            || name.eq_ignore_ascii_case("localhost")
            || self.names.iter().any(|own| own.eq_ignore_ascii_case(name))
    }
}

/// Lets through what [`Access`] allows, trades the token of an address for a cookie, and sets the headers that keep
/// browsers strict.
pub async fn guard(State(access): State<Arc<Access>>, request: Request, next: Next) -> Response {
    let query = request.uri().query().unwrap_or_default();
    let mut response = match access.check(request.method(), request.headers(), query) {
        Err((code, why)) => (code, why).into_response(),
        Ok(()) => match (request.uri().path(), parameter(query, "token"), &access.token) {
            // The secret does not stay in the address bar, nor in the history.
            ("/", Some(_), Some(token)) => {
                let host = request.headers().get(header::HOST).and_then(|host| host.to_str().ok()).unwrap_or_default();
                let cookie = format!("{}={}; HttpOnly; SameSite=Strict; Path=/", cookie_of(host), token.reveal());
                let others: Vec<&str> = query.split('&').filter(|part| !part.starts_with("token=")).collect();
                let place = if others.is_empty() { "/".to_owned() } else { format!("/?{}", others.join("&")) };
                let headers = [(header::SET_COOKIE, cookie), (header::LOCATION, place)];
                (StatusCode::SEE_OTHER, headers).into_response()
            }
            _ => next.run(request).await,
        },
    };
    let headers = response.headers_mut();
    for (name, value) in [
        (header::X_CONTENT_TYPE_OPTIONS, "nosniff"),
        (header::REFERRER_POLICY, "no-referrer"),
        (header::X_FRAME_OPTIONS, "DENY"),
        (
            header::CONTENT_SECURITY_POLICY,
            "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob: data:; connect-src 'self'; \
             form-action 'none'; frame-ancestors 'none'; base-uri 'none'",
        ),
        (header::CACHE_CONTROL, "no-store"),
        (HeaderName::from_static("cross-origin-resource-policy"), "same-origin"),
        (HeaderName::from_static("cross-origin-opener-policy"), "same-origin"),
    ] {
        headers.insert(name, HeaderValue::from_static(value));
    }
    response
}

/// The value of a parameter of a query, undecoded.
fn parameter<'a>(query: &'a str, name: &str) -> Option<&'a str> {
    query.split('&').find_map(|part| part.strip_prefix(name)?.strip_prefix('='))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn headers(pairs: &[(&str, &str)]) -> HeaderMap {
        let mut headers = HeaderMap::new();
        for (name, value) in pairs {
            let name: axum::http::HeaderName = name.parse().unwrap();
            headers.insert(name, value.parse().unwrap());
        }
        headers
    }

    fn code(access: &Access, method: Method, pairs: &[(&str, &str)], query: &str) -> u16 {
        access.check(&method, &headers(pairs), query).map_or_else(|(code, _)| code.as_u16(), |()| 200)
    }

    fn rules(address: &str, open: bool) -> Result<Access, PageError> {
        Access::new(&PageOptions { address: address.parse().unwrap(), names: vec![], open })
    }

    #[test]
    fn a_page_has_a_token_unless_it_is_open_to_this_machine_alone() {
        for address in ["127.0.0.1:80", "[::1]:80", "0.0.0.0:80", "[::]:80", "192.168.1.5:80"] {
            assert!(rules(address, false).unwrap().token.is_some(), "{address}");
            let open = rules(address, true).map(|access| access.token);
            let loopback = address.starts_with("127") || address.starts_with("[::1]");
            assert!(if loopback { matches!(open, Ok(None)) } else { matches!(open, Err(PageError::Open { .. })) });
        }
    }

    #[test]
    fn pages_at_two_ports_keep_their_cookies_apart() {
        assert_eq!(cookie_of("localhost:8100"), "erfgs_token_8100");
        assert_eq!(cookie_of("[::1]:8200"), "erfgs_token_8200");
        for host in ["localhost", "[::1]", "a:x"] {
            assert_eq!(cookie_of(host), "erfgs_token_80");
        }
    }

    #[test]
    fn names_that_a_foreign_site_could_point_here_are_refused() {
        let access = Access { token: None, names: vec!["rig.lab".into()] };
        for host in
            ["127.0.0.1:8100", "localhost:8100", "LOCALHOST", "[::1]:8100", "[::1]", "10.0.0.2:8100", "rig.lab:1"]
        {
            assert_eq!(code(&access, Method::GET, &[("host", host)], ""), 200, "{host}");
        }
        for host in ["evil.example:8100", "127.0.0.1.evil.example", "localhost.evil.example:8100", "", ":8100"] {
            assert_eq!(code(&access, Method::GET, &[("host", host)], ""), 403, "{host}");
        }
        assert_eq!(code(&access, Method::GET, &[], ""), 400);
    }

    #[test]
    fn other_sites_cannot_press_the_buttons() {
        let access = Access { token: None, names: vec![] };
        let ask = |method, origin| code(&access, method, &[("host", "127.0.0.1:8100"), ("origin", origin)], "");
        assert_eq!(ask(Method::POST, "http://127.0.0.1:8100"), 200);
        assert_eq!(ask(Method::POST, "http://127.0.0.1:9000"), 403);
        assert_eq!(ask(Method::POST, "http://evil.example"), 403);
        assert_eq!(ask(Method::POST, "null"), 403);
        assert_eq!(ask(Method::GET, "http://evil.example"), 403);
    }

    #[test]
    fn the_token_opens_by_address_header_or_cookie_and_nothing_else_does() {
        let access = rules("0.0.0.0:80", false).unwrap();
        let token = access.token.clone().unwrap().reveal().to_owned();
        let ask = |pairs: &[(&str, &str)], query: &str| {
            code(&access, Method::GET, &[pairs, &[("host", "10.0.0.2:80")]].concat(), query)
        };
        assert_eq!(ask(&[], &format!("token={token}")), 200);
        assert_eq!(ask(&[("authorization", &format!("Bearer {token}"))], ""), 200);
        assert_eq!(ask(&[("cookie", &format!("a=b; {COOKIE}80={token}"))], ""), 200);
        for query in ["", "token=", "token=0", &format!("token={token}0"), &format!("nottoken={token}")] {
            assert_eq!(ask(&[], query), 401, "{query}");
        }
        for cookie in [format!("{COOKIE}80=wrong"), format!("{COOKIE}81={token}")] {
            assert_eq!(ask(&[("cookie", &cookie)], ""), 401, "{cookie}");
        }
    }

    #[test]
    fn tokens_are_long_and_differ() {
        let (first, second) = (Token::random().unwrap(), Token::random().unwrap());
        assert!(first != second && first.reveal().len() == 32);
        assert_eq!(format!("{first:?}"), "Token(..)");
    }
}
