//! Who may see a page that is served: this machine alone, or who knows the token; and only under an address that cannot be
//! another site's name.

use std::{
    net::{IpAddr, SocketAddr},
    sync::{
        Arc, Mutex, PoisonError,
        atomic::{AtomicBool, Ordering},
    },
};

use axum::{
    Router,
    extract::{Request, State},
    http::{HeaderMap, HeaderName, HeaderValue, Method, StatusCode, Uri, header},
    middleware::{Next, from_fn_with_state},
    response::{IntoResponse, Response},
};

use tower_service::Service;

use crate::serve::{PageError, PageOptions};

/// Beginning of the name of the cookie that carries the token. The port follows: browsers tell hosts apart by cookies, not
/// ports, and there may be a page at another one. That page would be sent the cookie, too, were it not for its path, which nobody
/// else knows.
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
    /// The first part of the paths that browsers see, where there is a token: the cookie is sent to these alone.
    place: String,
    /// What opens the page once, until it has.
    once: Arc<Mutex<Option<Token>>>,
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
        let random = || Token::random().map_err(PageError::Token);
        let (token, place) = if *open { (None, String::new()) } else { (Some(random()?), random()?.0) };
        Ok(Self { token, names: names.clone(), place, once: Arc::default() })
    }

    /// An address that opens a server at `address` once: what stays of it in a browser's history is of no use to anybody.
    ///
    /// # Errors
    /// [`PageError::Token`] if no code can be drawn.
    pub fn url_for_once(&self, address: SocketAddr) -> Result<String, PageError> {
        if self.token.is_none() {
            return Ok(self.url(address));
        }
        let code = Token::random().map_err(PageError::Token)?;
        let url = format!("http://{address}/?once={}", code.reveal());
        *self.once.lock().unwrap_or_else(PoisonError::into_inner) = Some(code);
        Ok(url)
    }

    /// Whether this is the code of [`Self::url_for_once`], which is then used up.
    fn take_once(&self, offered: &str) -> bool {
        let mut once = self.once.lock().unwrap_or_else(PoisonError::into_inner);
        let is_it = once.as_ref().is_some_and(|code| code.is(offered));
        if is_it {
            *once = None;
        }
        is_it
    }

    /// The path of the page in browsers.
    fn path(&self) -> String {
        if self.place.is_empty() { "/".into() } else { format!("/{}/", self.place) }
    }

    /// The cookie of the page that is called as a request says, with the token.
    fn cookie(&self, headers: &HeaderMap, token: &Token) -> String {
        let host = headers.get(header::HOST).and_then(|host| host.to_str().ok()).unwrap_or_default();
        format!("{}={}; HttpOnly; SameSite=Strict; Path={}", cookie_of(host), token.reveal(), self.path())
    }

    /// A path as routes know it: without the part that browsers see before it.
    fn within(&self, uri: &Uri) -> Option<Uri> {
        let rest = uri.path_and_query()?.as_str().strip_prefix('/')?.strip_prefix(self.place.as_str())?;
        if self.place.is_empty() || !rest.starts_with('/') {
            return None;
        }
        rest.parse().ok()
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

/// Whether somebody who may see the page has asked for something over a connection.
#[derive(Clone, Debug, Default)]
pub(crate) struct Admitted(Arc<AtomicBool>);

impl Admitted {
    pub fn is_so(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }
}

/// `router`, for those whom `access` allows.
pub fn guarded(router: Router, access: Arc<Access>) -> Router {
    let router = router.layer(from_fn_with_state(Arc::clone(&access), guard));
    Router::new().fallback(move |mut request: Request| {
        if let Some(uri) = access.within(request.uri()) {
            *request.uri_mut() = uri;
        }
        router.clone().call(request)
    })
}

/// Lets through what [`Access`] allows, trades the token of an address for a cookie, and sets the headers that keep
/// browsers strict.
async fn guard(State(access): State<Arc<Access>>, request: Request, next: Next) -> Response {
    let query = request.uri().query().unwrap_or_default();
    let mut response = match access.check(request.method(), request.headers(), query) {
        Err((StatusCode::UNAUTHORIZED, _)) if enters_once(&access, &request) => entrance(&access, request.headers()),
        // Who is refused has no business with the connection, nor with the place that it takes.
        Err((code, why)) => (code, [(header::CONNECTION, "close")], why).into_response(),
        Ok(()) => {
            if let Some(Admitted(admitted)) = request.extensions().get() {
                admitted.store(true, Ordering::Relaxed);
            }
            match (request.uri().path(), parameter(query, "token"), &access.token) {
                // The secret does not stay in the address bar, nor in the history.
                ("/", Some(_), Some(token)) => {
                    let cookie = access.cookie(request.headers(), token);
                    let others: Vec<&str> = query.split('&').filter(|part| !part.starts_with("token=")).collect();
                    let others = if others.is_empty() { String::new() } else { format!("?{}", others.join("&")) };
                    let headers = [(header::SET_COOKIE, cookie), (header::LOCATION, access.path() + &others)];
                    (StatusCode::SEE_OTHER, headers).into_response()
                }
                _ => next.run(request).await,
            }
        }
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

/// Whether a request brings the code that opens the page once.
fn enters_once(access: &Access, request: &Request) -> bool {
    let code = parameter(request.uri().query().unwrap_or_default(), "once");
    request.uri().path() == "/" && request.method() == Method::GET && code.is_some_and(|code| access.take_once(code))
}

/// Gives the cookie, and goes on to the page. Not by a redirection: a browser that comes from a file or from another page would not send
/// the cookie along.
fn entrance(access: &Access, headers: &HeaderMap) -> Response {
    let Some(token) = &access.token else { return StatusCode::NOT_FOUND.into_response() };
    let kind = (header::CONTENT_TYPE, "text/html; charset=utf-8".to_owned());
    let text = format!(
        "<!doctype html><meta charset=\"utf-8\"><title>erfgs</title><meta http-equiv=\"refresh\" content=\"0; url={}\">",
        access.path()
    );
    ([kind, (header::SET_COOKIE, access.cookie(headers, token))], text).into_response()
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
        let access = Access { names: vec!["rig.lab".into()], ..rules("127.0.0.1:80", true).unwrap() };
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
        let access = rules("127.0.0.1:80", true).unwrap();
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
    fn a_code_opens_the_page_once() {
        let access = rules("127.0.0.1:80", false).unwrap();
        assert!(!access.take_once(""));
        let url = access.url_for_once("127.0.0.1:80".parse().unwrap()).unwrap();
        let code = url.split_once("?once=").unwrap().1;
        assert!(!url.contains(access.token.as_ref().unwrap().reveal()));
        assert!(!access.take_once("0123") && access.take_once(code) && !access.take_once(code));
    }

    #[test]
    fn browsers_send_the_cookie_to_a_path_that_only_this_page_knows() {
        let (access, other) = (rules("127.0.0.1:80", false).unwrap(), rules("127.0.0.1:81", false).unwrap());
        let cookie = access.cookie(&headers(&[("host", "127.0.0.1:80")]), &Token::random().unwrap());
        assert!(
            cookie.contains("SameSite=Strict") && cookie.ends_with(&format!("Path=/{}/", access.place)),
            "{cookie}"
        );
        assert!(access.place.len() == 32 && access.place != other.place);
        let within = |path: &str| access.within(&path.parse().unwrap()).map(|uri| uri.to_string());
        let place = access.place.clone();
        assert_eq!(within(&format!("/{place}/")), Some("/".into()));
        assert_eq!(within(&format!("/{place}/api/x?t=1")), Some("/api/x?t=1".into()));
        for path in ["/", "/api/x", &format!("/{place}"), &format!("/{place}x/"), &format!("/{}/", other.place)] {
            assert_eq!(within(path), None, "{path}");
        }
    }

    #[test]
    fn tokens_are_long_and_differ() {
        let (first, second) = (Token::random().unwrap(), Token::random().unwrap());
        assert!(first != second && first.reveal().len() == 32);
        assert_eq!(format!("{first:?}"), "Token(..)");
    }
}
