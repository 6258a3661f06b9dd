//! Response bodies in bounded pieces. The last piece holds the request's guard until the connection has sent it.
//!
//! hyper takes the next piece of a body when it has nearly sent the one before. So a slow client makes it hold one piece, and
//! the rest stays part of the budget of bytes in flight.

use super::{request_guard::RequestGuard, stream_progress::StreamProgress};
use axum::body::{Body, Bytes, HttpBody};
use bytes::Buf;
use http_body::{Frame, SizeHint};
use std::{
    mem::take,
    pin::Pin,
    sync::Arc,
    task::{Context, Poll, ready},
};

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
    guard: Option<RequestGuard>,
}

impl GuardedBody {
    pub(super) fn new(body: ResponseBody, guard: RequestGuard) -> Self {
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

/// A piece of a body. The connection drops it when it has sent its last byte.
pub(super) struct ResponsePiece {
    bytes: Bytes,
    stream: Option<Arc<StreamProgress>>,
    guard: Option<RequestGuard>,
}

impl ResponsePiece {
    /// The bytes without the guard.
    pub(super) fn into_bytes(self) -> Bytes {
        drop(self.guard);
        self.bytes
    }
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
