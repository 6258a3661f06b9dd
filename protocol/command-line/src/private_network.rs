//! Addresses of this machine and of its private network. The owner of a name could lead a client there from the outside: the name
//! has a public address first, and a private one at the next connection.

use reqwest::dns::{Addrs, Name, Resolve, Resolving};
use std::collections::HashMap;
use std::io;
use std::net::{IpAddr, Ipv4Addr, SocketAddr};
use std::sync::{Arc, Mutex, PoisonError};

/// Names that are known at the same time. Servers that may redirect anywhere could lead to names without end.
const MAX_NAMES: usize = 10_000;

/// Whether an address is of this machine, of its private network or of a carrier's, and not of the internet. IPv6 addresses that
/// stand for IPv4 addresses are what these are.
fn is_private(address: IpAddr) -> bool {
    let address = match address.to_canonical() {
        IpAddr::V4(address) => return is_private_v4(address),
        IpAddr::V6(address) => address.segments(),
    };
    let is_private_part = |high: u16, low: u16| is_private_v4(Ipv4Addr::from((u32::from(high) << 16) | u32::from(low)));
    match address {
        // "::", "::1", and the oldest notation of IPv4 addresses; those of translators (RFC 6052); those of 6to4 (RFC 3056).
        [0, 0, 0, 0, 0, 0, high, low] | [0x64, 0xff9b, 0, 0, 0, 0, high, low] | [0x2002, high, low, ..] => {
            is_private_part(high, low)
        }
        // Translators of one network (RFC 8215).
        [0x64, 0xff9b, 1, ..] => true,
        // Unique local, link-local and site-local addresses, and groups.
        [first, ..] => {
            first & 0xfe00 == 0xfc00 || matches!(first & 0xffc0, 0xfe80 | 0xfec0) || first & 0xff00 == 0xff00
        }
    }
}

fn is_private_v4(address: Ipv4Addr) -> bool {
    match address.octets() {
        [0 | 10 | 127, ..] | [169, 254, ..] | [192, 168, ..] | [192, 0, 0, _] => true,
        [172, second, ..] => second & 0xf0 == 16,
        // Networks of carriers (RFC 6598), and of measurements (RFC 2544).
        [100, second, ..] => second & 0xc0 == 64,
        [198, second, ..] => second & 0xfe == 18,
        // Groups and reserved addresses.
        [first, ..] => first >= 224,
    }
}

/// Looks names up. What a name had first decides: a name with private addresses is of the private network, which its user meant,
/// and only they are connected to. From the first time that it has public addresses alone, it may have no private ones.
pub(super) struct GuardedNames<L> {
    lookup: L,
    /// Whether a name is of the internet.
    is_public: Arc<Mutex<HashMap<String, bool>>>,
}

impl<L: Resolve> GuardedNames<L> {
    pub(super) fn new(lookup: L) -> Self {
        Self { lookup, is_public: Arc::default() }
    }
}

impl<L: Resolve> Resolve for GuardedNames<L> {
    fn resolve(&self, name: Name) -> Resolving {
        let (shown, is_public) = (name.as_str().to_owned(), Arc::clone(&self.is_public));
        let found = self.lookup.resolve(name);
        Box::pin(async move {
            let found = found.await?.collect();
            let allowed = allowed(&mut is_public.lock().unwrap_or_else(PoisonError::into_inner), shown, found)?;
            Ok(Box::new(allowed.into_iter()) as Addrs)
        })
    }
}

/// The addresses of a name to which a client may connect. Fails if there is none.
fn allowed(is_public: &mut HashMap<String, bool>, name: String, found: Vec<SocketAddr>) -> io::Result<Vec<SocketAddr>> {
    let (private, public): (Vec<_>, Vec<_>) = found.into_iter().partition(|address| is_private(address.ip()));
    let was_public = is_public.get(&name).copied().unwrap_or(is_public.len() >= MAX_NAMES);
    if was_public || private.is_empty() {
        if let Some(address) = private.first().filter(|_| public.is_empty()) {
            let what = format!(
                "{name} had an address of the internet, and now has {}, of this machine or its private network; if that is \
                 meant, start again, or give that address itself",
                address.ip()
            );
            return Err(io::Error::new(io::ErrorKind::PermissionDenied, what));
        }
        if is_public.len() < MAX_NAMES && !public.is_empty() {
            is_public.insert(name, true);
        }
        return Ok(public);
    }
    is_public.insert(name, false);
    Ok(private)
}

/// Asks the system.
pub(super) struct SystemNames;

impl Resolve for SystemNames {
    fn resolve(&self, name: Name) -> Resolving {
        Box::pin(async move {
            // Port 0 stands for that of the URL.
            let found: Vec<SocketAddr> = tokio::net::lookup_host((name.as_str(), 0)).await?.collect();
            Ok(Box::new(found.into_iter()) as Addrs)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::pin::pin;
    use std::task::{Context, Poll, Waker};

    const PUBLIC: &str = "93.184.215.14";

    #[test]
    fn addresses_are_private_in_each_notation() {
        for private in [
            "127.0.0.1", "127.255.0.9", "0.0.0.0", "10.1.2.3", "172.16.0.1", "172.31.255.255", "192.168.1.1",
            "169.254.169.254", "100.64.0.1", "100.127.255.255", "192.0.0.8", "198.19.0.1", "224.0.0.1",
            "255.255.255.255", "::", "::1", "::ffff:127.0.0.1", "::ffff:169.254.169.254", "::10.0.0.1",
            "64:ff9b::10.0.0.1", "64:ff9b:1::1", "2002:7f00:1::", "fc00::1", "fdff::1", "fe80::1", "fec0::1",
            "ff02::1",
        ] {
            assert!(is_private(private.parse().unwrap()), "{private}");
        }
        for public in [
            PUBLIC, "1.1.1.1", "100.63.0.1", "100.128.0.1", "172.15.0.1", "172.32.0.1", "192.0.2.1", "198.20.0.1",
            "::ffff:1.1.1.1", "64:ff9b::1.1.1.1", "2002:101:101::", "2606:4700::1111",
        ] {
            assert!(!is_private(public.parse().unwrap()), "{public}");
        }
    }

    /// Gives the next of its lists at each lookup.
    struct ListedNames(Mutex<Vec<&'static [&'static str]>>);

    impl Resolve for ListedNames {
        fn resolve(&self, _name: Name) -> Resolving {
            let addresses = self.0.lock().unwrap().remove(0);
            let addresses = addresses.iter().map(|ip| SocketAddr::new(ip.parse().unwrap(), 0));
            Box::pin(std::future::ready(Ok(Box::new(addresses) as Addrs)))
        }
    }

    /// The addresses that lookups of one name give, in order.
    fn lookups(answers: &[&'static [&'static str]]) -> Vec<Result<Vec<String>, String>> {
        let names = GuardedNames::new(ListedNames(Mutex::new(answers.to_vec())));
        let lookup = |_: &&'static [&'static str]| {
            let mut found = pin!(names.resolve("city.example.org".parse().unwrap()));
            match found.as_mut().poll(&mut Context::from_waker(Waker::noop())) {
                Poll::Ready(Ok(found)) => Ok(found.map(|address| address.ip().to_string()).collect()),
                Poll::Ready(Err(error)) => Err(error.to_string()),
                Poll::Pending => panic!("the lookup waits"),
            }
        };
        answers.iter().map(lookup).collect()
    }

    #[test]
    fn a_name_of_the_internet_never_leads_into_the_private_network() {
        const PRIVATE: [&[&str]; 3] = [&["127.0.0.1"], &["169.254.169.254"], &["::ffff:10.0.0.1", "fd00::1"]];
        for private in PRIVATE {
            let found = lookups(&[&[PUBLIC], private, &[PUBLIC]]);
            assert_eq!(found[0], Ok(vec![PUBLIC.to_owned()]));
            let error = found[1].as_ref().unwrap_err();
            assert!(error.contains("city.example.org") && error.contains("private network"), "{error}");
            assert_eq!(found[2], found[0]);
        }
        // Private addresses beside a public one, to which a client would turn when the public one does not answer.
        let found = lookups(&[&[PUBLIC], &["10.0.0.1", PUBLIC]]);
        assert_eq!(found[1], Ok(vec![PUBLIC.to_owned()]));
        // The owner of a name could begin with a private address.
        assert!(lookups(&[&["10.0.0.1"], &[PUBLIC], &["10.0.0.1"]])[2].is_err());
        assert_eq!(lookups(&[&[PUBLIC, "10.0.0.1"]]), [Ok(vec!["10.0.0.1".to_owned()])]);
    }

    #[test]
    fn names_of_the_private_network_are_connected_to() {
        let own: &[&str] = &["192.168.1.5", "fe80::1"];
        assert!(lookups(&[own, own]).iter().all(|found| found.as_ref().is_ok_and(|found| found == own)));
        assert_eq!(lookups(&[&[], own])[1].as_ref().unwrap(), own, "a lookup without a result decides nothing");
    }

    #[test]
    fn names_past_the_limit_are_of_the_internet() {
        let mut known = (0..MAX_NAMES).map(|i| (i.to_string(), true)).collect();
        let address = SocketAddr::new("127.0.0.1".parse().unwrap(), 0);
        assert!(allowed(&mut known, "new".into(), vec![address]).is_err());
        assert_eq!(known.len(), MAX_NAMES);
    }
}
