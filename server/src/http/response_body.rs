//! Response bodies in bounded pieces. The last piece holds the request's guard until the connection has sent it.
//!
//! hyper takes the next piece of a body when it has nearly sent the one before. So a slow client makes it hold one piece, and
//! the rest stays part of the budget of bytes in flight.

use super::request_guard::RequestGuard;
use super::stream_progress::StreamProgress;
use axum::body::{Body, Bytes, HttpBody};
use bytes::Buf;
use http_body::{Frame, SizeHint};
use std::mem::take;
use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll, ready};

/// Size of the largest piece of a body.
const PIECE_BYTES: usize = 64 << 10;

/// A body in memory, or one of the router's.
pub(super) enum ResponseBody {
    Full(Bytes),
    Routed(Body),
}

impl ResponseBody {
    pub(super) fn len(&self) -> usize {
        self.size_hint().lower() as usize
    }

    fn is_end_stream(&self) -> bool {
        match self {
            Self::Full(bytes) => bytes.is_empty(),
            Self::Routed(body) => body.is_end_stream(),
        }
    }

    fn size_hint(&self) -> SizeHint {
        match self {
            Self::Full(bytes) => SizeHint::with_exact(bytes.len() as u64),
            Self::Routed(body) => body.size_hint(),
        }
    }
}

/// A response body with its request's guard.
pub(super) struct GuardedBody {
    body: ResponseBody,
    /// What was taken from `body` and not yet passed on.
    rest: Bytes,
    /// `None` after the last piece.
    guard: Option<Box<RequestGuard>>,
}

impl GuardedBody {
    pub(super) fn new(body: ResponseBody, guard: Box<RequestGuard>) -> Self {
        guard.response_started();
        Self { body, rest: Bytes::new(), guard: Some(guard) }
    }

    /// The next bytes of the body that are not empty; `None` at its end.
    fn poll_bytes(&mut self, context: &mut Context<'_>) -> Poll<Option<Result<Bytes, axum::Error>>> {
        loop {
            let bytes = match &mut self.body {
                ResponseBody::Full(bytes) if bytes.is_empty() => return Poll::Ready(None),
                ResponseBody::Full(bytes) => take(bytes),
                ResponseBody::Routed(body) => match ready!(Pin::new(body).poll_frame(context)) {
                    // No route sends trailers.
                    Some(Ok(frame)) => frame.into_data().unwrap_or_default(),
                    Some(Err(error)) => return Poll::Ready(Some(Err(error))),
                    None => return Poll::Ready(None),
                },
            };
            if !bytes.is_empty() {
                return Poll::Ready(Some(Ok(bytes)));
            }
        }
    }
}

impl HttpBody for GuardedBody {
    type Data = ResponsePiece;
    type Error = axum::Error;

    fn poll_frame(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
    ) -> Poll<Option<Result<Frame<ResponsePiece>, axum::Error>>> {
        if self.rest.is_empty() {
            match ready!(self.poll_bytes(context)) {
                Some(Ok(bytes)) => self.rest = bytes,
                ended => {
                    self.guard = None;
                    return Poll::Ready(ended.and_then(Result::err).map(Err));
                }
            }
        }
        let length = self.rest.len().min(PIECE_BYTES);
        let bytes = self.rest.split_to(length);
        let is_last = self.is_end_stream();
        let mut piece = ResponsePiece { bytes, stream: None, guard: None };
        if let Some(guard) = &mut self.guard {
            guard.bytes_sent(length);
            piece.stream = guard.stream().cloned();
        }
        piece.guard = self.guard.take_if(|_| is_last);
        Poll::Ready(Some(Ok(Frame::data(piece))))
    }

    fn is_end_stream(&self) -> bool {
        self.rest.is_empty() && self.body.is_end_stream()
    }

    fn size_hint(&self) -> SizeHint {
        let (hint, rest) = (self.body.size_hint(), self.rest.len() as u64);
        let mut whole = SizeHint::new();
        whole.set_lower(hint.lower() + rest);
        if let Some(upper) = hint.upper() {
            whole.set_upper(upper + rest);
        }
        whole
    }
}

/// The same body in plain bytes, for callers that hold it themselves: a piece is sent when it is taken.
pub(super) struct PlainBody(pub(super) GuardedBody);

impl HttpBody for PlainBody {
    type Data = Bytes;
    type Error = axum::Error;

    fn poll_frame(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
    ) -> Poll<Option<Result<Frame<Bytes>, axum::Error>>> {
        let frame = ready!(Pin::new(&mut self.0).poll_frame(context));
        Poll::Ready(frame.map(|frame| frame.map(|frame| frame.map_data(|piece| piece.bytes))))
    }

    fn is_end_stream(&self) -> bool {
        self.0.is_end_stream()
    }

    fn size_hint(&self) -> SizeHint {
        self.0.size_hint()
    }
}

/// A piece of a body. The connection drops it when it has sent its last byte.
pub(super) struct ResponsePiece {
    bytes: Bytes,
    stream: Option<Arc<StreamProgress>>,
    guard: Option<Box<RequestGuard>>,
}

impl Buf for ResponsePiece {
    fn remaining(&self) -> usize {
        self.bytes.len()
    }

    fn chunk(&self) -> &[u8] {
        &self.bytes
    }

    fn advance(&mut self, count: usize) {
        if let Some(stream) = &self.stream {
            stream.bytes_taken(count);
        }
        self.bytes.advance(count);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::ServeConfig;
    use crate::http::state::AppState;
    use crate::store::Store;
    use insula_protocol::route::RouteTemplate;
    use std::task::Waker;

    #[test]
    fn a_large_body_is_counted_until_its_last_piece_is_sent() {
        let mut config = ServeConfig::default();
        (config.limits.in_flight, config.limits.in_flight_bytes) = (1, 20 << 20);
        let state = AppState::new(Store::default(), &config);
        for routed in [false, true] {
            let mut guard = Box::new(RequestGuard::new(&state, None, RouteTemplate::Cities, false));
            assert!(guard.try_enter() && guard.try_reserve(20 << 20));
            let bytes = Bytes::from(vec![7; (20 << 20) - 5]);
            let body = if routed { ResponseBody::Routed(bytes.into()) } else { ResponseBody::Full(bytes) };
            let mut body = Box::pin(GuardedBody::new(body, guard));
            let (mut taken, mut last) = (0, None);
            while let Poll::Ready(Some(Ok(frame))) = body.as_mut().poll_frame(&mut Context::from_waker(Waker::noop())) {
                let mut piece = frame.into_data().unwrap_or_else(|_| panic!("no trailers"));
                assert!(piece.remaining() <= PIECE_BYTES);
                taken += piece.remaining();
                piece.advance(piece.remaining());
                last = Some(piece);
                if body.is_end_stream() {
                    break;
                }
                assert_eq!(state.in_flight.requests(), 1);
            }
            assert_eq!(taken, (20 << 20) - 5);
            drop(body);
            assert_eq!(state.in_flight.requests(), 1, "the last piece is not sent");
            assert!(!state.in_flight.try_reserve(1));
            drop(last);
            assert_eq!(state.in_flight.requests(), 0);
        }
    }
}
