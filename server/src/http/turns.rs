//! Turns of a thread's tasks: clients share its time equally, however many connections and requests each has.
//!
//! Tokio polls tasks in the order in which they are woken. A client that keeps thousands of them ready makes everyone else
//! wait for all of them. With several clients on a thread, a client's tasks therefore wait for each other: one of them runs,
//! then every other client's next one.

use std::cell::{Cell, RefCell};
use std::collections::{HashMap, VecDeque};
use std::future::{Future, poll_fn};
use std::net::IpAddr;
use std::pin::Pin;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::sync::atomic::Ordering::Relaxed;
use std::task::{Context, Poll, Waker};
use tokio::task::yield_now;

/// Requests that a connection may pass to the service in one turn.
const REQUESTS_PER_TURN: u32 = 4;
/// Bytes that it may read in one turn. HTTP/2 passes on all requests of a read at once.
const BYTES_PER_TURN: usize = 256;

thread_local! {
    static TURNS: RefCell<Turns> = RefCell::default();
    /// Requests, and bytes read, since the current turn began.
    static REQUESTS: Cell<u32> = const { Cell::new(0) };
    static BYTES: Cell<usize> = const { Cell::new(0) };
}

/// The clients with tasks on this thread.
#[derive(Default)]
struct Turns {
    clients: HashMap<IpAddr, ClientTurns>,
    /// Clients of which a task has run or may run in this round.
    taken: Vec<IpAddr>,
    /// Ends the round. It waits behind all tasks that are ready, because tokio's queue is in order.
    round: Option<Waker>,
    is_round_spawned: bool,
}

#[derive(Default)]
struct ClientTurns {
    tasks: usize,
    is_taken: bool,
    waiting: VecDeque<Ticket>,
}

/// A task that waits for its turn.
struct Ticket {
    granted: Arc<AtomicBool>,
    waker: Waker,
}

/// Whether clients wait for each other on this thread.
fn has_several_clients() -> bool {
    TURNS.with_borrow(|turns| turns.clients.len() > 1)
}

/// Ends the turn of the running task if other clients have tasks on this thread.
pub(super) async fn end_turn() {
    if has_several_clients() {
        yield_now().await;
    }
}

/// How many bytes the running task may still read in its turn; `None` if there is no other client.
pub(super) fn readable_bytes() -> Option<usize> {
    has_several_clients().then(|| BYTES_PER_TURN.saturating_sub(BYTES.get()))
}

/// Counts bytes that the running task has read.
pub(super) fn count_read(bytes: usize) {
    BYTES.set(BYTES.get() + bytes);
}

/// Whether the running task has passed on as many requests as its turn allows, while other clients wait. Counts one request.
pub(super) fn is_turn_over() -> bool {
    REQUESTS.set(REQUESTS.get() + 1);
    REQUESTS.get() > REQUESTS_PER_TURN && has_several_clients()
}

/// A task of a client that waits for its turns.
pub(super) struct InTurn<F> {
    client: IpAddr,
    is_counted: bool,
    is_waiting: bool,
    granted: Arc<AtomicBool>,
    future: Pin<Box<F>>,
}

impl<F> InTurn<F> {
    pub(super) fn new(client: IpAddr, future: F) -> Self {
        let granted = Arc::default();
        Self { client, is_counted: false, is_waiting: false, granted, future: Box::pin(future) }
    }

    /// Takes the turn if it is the task's. Otherwise `waker` is woken when it is.
    fn takes_turn(&mut self, waker: &Waker) -> bool {
        TURNS.with_borrow_mut(|turns| {
            let client = turns.clients.entry(self.client).or_default();
            client.tasks += usize::from(!std::mem::replace(&mut self.is_counted, true));
            let is_alone = turns.clients.len() <= 1;
            if is_alone || self.is_waiting && self.granted.swap(false, Relaxed) {
                self.is_waiting = false;
                return true;
            }
            if self.is_waiting {
                return false;
            }
            let Some(client) = turns.clients.get_mut(&self.client) else { return true };
            if client.is_taken {
                self.is_waiting = true;
                self.granted.store(false, Relaxed);
                client.waiting.push_back(Ticket { granted: self.granted.clone(), waker: waker.clone() });
                return false;
            }
            client.is_taken = true;
            turns.taken.push(self.client);
            turns.start_round();
            true
        })
    }
}

impl<F: Future> Future for InTurn<F> {
    type Output = F::Output;

    fn poll(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<F::Output> {
        if !self.takes_turn(context.waker()) {
            return Poll::Pending;
        }
        REQUESTS.set(0);
        BYTES.set(0);
        self.future.as_mut().poll(context)
    }
}

impl<F> Drop for InTurn<F> {
    fn drop(&mut self) {
        if !self.is_counted {
            return;
        }
        // The thread may be ending. What is removed is dropped outside of the borrow.
        let _left = TURNS.try_with(|turns| {
            let mut turns = turns.borrow_mut();
            let client = turns.clients.get_mut(&self.client)?;
            client.tasks -= 1;
            if client.tasks == 0 { turns.clients.remove(&self.client) } else { None }
        });
    }
}

impl Turns {
    fn start_round(&mut self) {
        if let Some(round) = &self.round {
            round.wake_by_ref();
        } else if !self.is_round_spawned {
            self.is_round_spawned = true;
            tokio::spawn(poll_fn(end_round));
        }
    }
}

/// Gives each client that had a turn the next one, if it has a task that waits.
fn end_round(context: &mut Context<'_>) -> Poll<()> {
    let granted: Vec<Ticket> = TURNS.with_borrow_mut(|turns| {
        let Turns { clients, taken, round, .. } = turns;
        if round.is_none() {
            *round = Some(context.waker().clone());
        }
        let mut granted = Vec::new();
        taken.retain(|ip| {
            let Some(client) = clients.get_mut(ip) else { return false };
            let next = client.waiting.pop_front();
            client.is_taken = next.is_some();
            granted.extend(next);
            client.is_taken
        });
        granted
    });
    for ticket in &granted {
        ticket.granted.store(true, Relaxed);
        ticket.waker.wake_by_ref();
    }
    if !granted.is_empty() {
        context.waker().wake_by_ref();
    }
    Poll::Pending
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Lets other tasks run. Tokio's `yield_now` also waits for its driver.
    async fn yield_once() {
        let mut has_yielded = false;
        poll_fn(|context| {
            context.waker().wake_by_ref();
            if std::mem::replace(&mut has_yielded, true) { Poll::Ready(()) } else { Poll::Pending }
        })
        .await;
    }

    /// Runs tasks that each note their client `polls` times, and returns the clients in the order of their turns.
    async fn order_of_turns(tasks: &[(u8, usize)]) -> Vec<u8> {
        let order = Arc::new(std::sync::Mutex::new(Vec::new()));
        let spawned: Vec<_> = tasks
            .iter()
            .map(|(client, polls)| {
                let (client, polls, order) = (*client, *polls, order.clone());
                tokio::spawn(InTurn::new([192, 0, 2, client].into(), async move {
                    for _ in 0..polls {
                        order.lock().unwrap().push(client);
                        yield_once().await;
                    }
                }))
            })
            .collect();
        for task in spawned {
            task.await.unwrap();
        }
        let order = order.lock().unwrap();
        order.clone()
    }

    #[tokio::test]
    async fn clients_share_the_time_of_a_thread() {
        // A hundred tasks of one client, and one of another that needs ten turns.
        let tasks: Vec<(u8, usize)> = (0..100).map(|_| (1, 20)).chain([(2, 10)]).collect();
        let order = order_of_turns(&tasks).await;
        assert_eq!(order.len(), 2010);
        let last = order.iter().rposition(|client| *client == 2).unwrap();
        // Before the second client has a task, all of the first one run once.
        assert!(last < 140, "the other client's last turn is number {last}");
        assert!(TURNS.with_borrow(|turns| turns.clients.is_empty()), "all tasks have ended");
    }

    #[tokio::test]
    async fn client_without_others_does_not_wait() {
        let order = order_of_turns(&[(1, 3), (1, 3)]).await;
        assert_eq!(order, [1; 6]);
        assert!(TURNS.with_borrow(|turns| turns.round.is_none()), "no round was started");
    }

    #[tokio::test]
    async fn dropped_tasks_leave_the_turn_to_the_next() {
        let ended = InTurn::new([192, 0, 2, 1].into(), std::future::pending::<()>());
        let tasks: Vec<_> = (0..3)
            .map(|_| tokio::spawn(InTurn::new([192, 0, 2, 1].into(), std::future::pending::<()>())))
            .chain([tokio::spawn(ended)])
            .collect();
        tokio::spawn(InTurn::new([192, 0, 2, 2].into(), yield_once())).await.unwrap();
        tasks.iter().for_each(|task| task.abort());
        yield_once().await;
        assert_eq!(order_of_turns(&[(1, 2), (2, 2)]).await.len(), 4);
    }
}
