//! A queue of work that takes long: a few pieces run at once, and clients take turns, however many requests each of them has.
//!
//! Among the clients that wait, the one with the fewest running pieces is next, in turn. One client never has all running places if
//! there are several. If the queue is full, the newest request of the client that waits with the most is given up for one of a client
//! with fewer.
//!
//! A place is not yet a core: the work of a client that asks for much at a time runs on threads of low priority, so that the system gives
//! the cores to that of others, and to the threads that respond, whenever these need them.

use super::problem::Problem;
use std::collections::{HashMap, VecDeque};
use std::future::Future;
use std::net::IpAddr;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::AtomicBool;
use std::sync::atomic::Ordering::Relaxed;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, mpsc};
use std::time::Duration;
use tokio::runtime::Handle;
use tokio::sync::oneshot;
use tokio::task::spawn_blocking;
use tokio::time::timeout;

/// What is added to the nice value of threads with [`WorkPriority::Low`]. Not the lowest: other programs of the machine must not bring such work to a halt.
#[cfg(target_os = "linux")]
const LOW_NICE: i32 = 10;

#[derive(Debug, Clone, Copy)]
pub(super) struct QueueLimits {
    /// Pieces of work that run at the same time.
    pub(super) at_once: usize,
    /// Requests that wait for that.
    pub(super) waiting: usize,
    /// Pieces of one client, running or waiting, beyond which those that start have low priority.
    pub(super) at_ease: usize,
    /// Work that waits or runs longer has failed.
    pub(super) max_time: Duration,
}

/// With which right to a core a piece of work runs. A thread keeps the lower one: only administrators may raise it again.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum WorkPriority {
    Normal,
    Low,
}

/// Work was given up: the queue is full, it took too long, or it panicked.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Shed;

impl Shed {
    /// 503 with `Retry-After`.
    pub(super) fn problem(self) -> Problem {
        Problem::unavailable("too much of this is being computed: retry in a second")
    }
}

/// Whether the request of a piece of work still waits for it.
#[derive(Debug, Clone, Default)]
pub(super) struct StopFlag(Arc<AtomicBool>);

impl StopFlag {
    /// Nobody waits for the work any more.
    pub(super) fn is_stopped(&self) -> bool {
        self.0.load(Relaxed)
    }
}

/// Sets the flag when it is dropped: with the request.
struct StopOnDrop(StopFlag);

impl Drop for StopOnDrop {
    fn drop(&mut self) {
        self.0.0.store(true, Relaxed);
    }
}

/// See the module. Cheap to clone.
#[derive(Debug, Clone)]
pub(super) struct FairQueue {
    limits: QueueLimits,
    state: Arc<Mutex<QueueState>>,
}

#[derive(Debug, Default)]
struct QueueState {
    running: usize,
    waiting: usize,
    next_ticket: u64,
    /// Clients with work that runs or waits.
    clients: HashMap<IpAddr, ClientWork>,
    /// Clients with work that waits, in the order of their turns.
    turns: VecDeque<IpAddr>,
}

#[derive(Debug, Default)]
struct ClientWork {
    running: usize,
    /// Numbers of waiting requests, oldest first. A sender without a message that is dropped gives the request up.
    tickets: VecDeque<(u64, oneshot::Sender<WorkPriority>)>,
}

/// A place in the queue: a request that waits or whose work runs. Dropping it frees the place.
struct QueuePlace {
    queue: FairQueue,
    client: IpAddr,
    ticket: u64,
    granted: oneshot::Receiver<WorkPriority>,
    is_running: bool,
}

impl FairQueue {
    pub(super) fn new(limits: QueueLimits) -> Self {
        Self { limits, state: Arc::default() }
    }

    /// Runs `work` on a thread of its own when it is the client's turn. The work should end soon once its flag is set; until it ends, it
    /// keeps its place.
    pub(super) async fn run<T: Send + 'static>(
        &self,
        client: IpAddr,
        work: impl FnOnce(&StopFlag) -> T + Send + 'static,
    ) -> Result<T, Shed> {
        let stop = StopOnDrop(StopFlag::default());
        let flag = stop.0.clone();
        let task = async {
            let (place, priority) = self.enter(client)?.turn().await?;
            let work = move || {
                let result = work(&flag);
                drop(place);
                result
            };
            match priority {
                WorkPriority::Normal => spawn_blocking(work).await.map_err(|_| Shed),
                WorkPriority::Low => on_low_thread(|_| work()).await,
            }
        };
        timeout(self.limits.max_time, task).await.unwrap_or(Err(Shed))
    }

    /// Awaits `work`, which does not block, when it is the client's turn: on this thread, unless it has low priority.
    pub(super) async fn wait_for<T: Send + 'static>(
        &self,
        client: IpAddr,
        work: impl Future<Output = T> + Send + 'static,
    ) -> Result<T, Shed> {
        let task = async {
            let (place, priority) = self.enter(client)?.turn().await?;
            if priority == WorkPriority::Normal {
                let result = work.await;
                drop(place);
                return Ok(result);
            }
            let runtime = Handle::current();
            let ended = on_low_thread(move |request| {
                let _place = place;
                runtime.block_on(async {
                    tokio::select! {
                        result = work => Some(result),
                        () = request.closed() => None,
                    }
                })
            });
            ended.await?.ok_or(Shed)
        };
        timeout(self.limits.max_time, task).await.unwrap_or(Err(Shed))
    }

    /// Takes a place. Fails if the queue is full, and no other client waits with more requests.
    fn enter(&self, client: IpAddr) -> Result<QueuePlace, Shed> {
        let (sender, granted) = oneshot::channel();
        let mut state = self.lock();
        let ticket = state.next_ticket;
        state.next_ticket += 1;
        let work = state.clients.entry(client).or_default();
        work.tickets.push_back((ticket, sender));
        if work.tickets.len() == 1 {
            state.turns.push_back(client);
        }
        state.waiting += 1;
        state.grant(self.limits);
        let is_shed = state.waiting > self.limits.waiting && state.shed(client) == ticket;
        drop(state);
        let place = QueuePlace { queue: self.clone(), client, ticket, granted, is_running: false };
        if is_shed { Err(Shed) } else { Ok(place) }
    }

    /// Requests that wait.
    #[cfg(test)]
    pub(super) fn waiting(&self) -> usize {
        self.lock().waiting
    }

    fn lock(&self) -> MutexGuard<'_, QueueState> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl QueueLimits {
    /// Running places of one client: three quarters, but not all of several.
    fn of_client(self) -> usize {
        super::client_usage::default_share(self.at_once)
    }
}

impl QueueState {
    /// Starts the work of the clients whose turn it is.
    fn grant(&mut self, limits: QueueLimits) {
        while self.running < limits.at_once {
            let running = |client: &IpAddr| self.clients.get(client).map_or(0, |work| work.running);
            let next = self.turns.iter().enumerate().min_by_key(|(_, client)| running(client));
            let Some((turn, client)) = next.filter(|(_, client)| running(client) < limits.of_client()) else { return };
            let client = *client;
            self.turns.remove(turn);
            let Some(work) = self.clients.get_mut(&client) else { continue };
            let Some((_, granted)) = work.tickets.pop_front() else { continue };
            if !work.tickets.is_empty() {
                self.turns.push_back(client);
            }
            work.running += 1;
            let pieces = work.running + work.tickets.len();
            let priority = if pieces > limits.at_ease { WorkPriority::Low } else { WorkPriority::Normal };
            self.running += 1;
            self.waiting -= 1;
            // The receiver lives as long as its place, which frees what was granted.
            let _ = granted.send(priority);
        }
    }

    /// Gives up the newest request of the client that waits with the most, which is that of `newcomer` unless another one would still have
    /// as many. Returns its ticket.
    fn shed(&mut self, newcomer: IpAddr) -> u64 {
        let waiting = |client: &IpAddr| self.clients.get(client).map_or(0, |work| work.tickets.len());
        let most = self.turns.iter().max_by_key(|client| waiting(client)).copied().unwrap_or(newcomer);
        let client = if waiting(&most) > waiting(&newcomer) { most } else { newcomer };
        let newest = self.clients.get_mut(&client).and_then(|work| work.tickets.pop_back());
        let ticket = newest.map_or(u64::MAX, |(ticket, _)| ticket);
        self.waiting -= usize::from(ticket != u64::MAX);
        self.forget_idle(client);
        ticket
    }

    /// Removes a client without waiting work from the turns, and one without any work from the table.
    fn forget_idle(&mut self, client: IpAddr) {
        let Some(work) = self.clients.get(&client) else { return };
        if work.tickets.is_empty() {
            self.turns.retain(|other| *other != client);
            if work.running == 0 {
                self.clients.remove(&client);
            }
        }
    }
}

impl QueuePlace {
    /// Waits until the work may run.
    async fn turn(mut self) -> Result<(Self, WorkPriority), Shed> {
        let priority = (&mut self.granted).await.map_err(|_| Shed)?;
        self.is_running = true;
        Ok((self, priority))
    }
}

impl Drop for QueuePlace {
    fn drop(&mut self) {
        let mut state = self.queue.lock();
        let is_running = self.is_running || self.granted.try_recv().is_ok();
        let Some(work) = state.clients.get_mut(&self.client) else { return };
        if is_running {
            work.running -= 1;
            state.running -= 1;
        } else {
            let before = work.tickets.len();
            work.tickets.retain(|(ticket, _)| *ticket != self.ticket);
            let left = before - work.tickets.len();
            state.waiting -= left;
        }
        state.forget_idle(self.client);
        state.grant(self.queue.limits);
    }
}

/// Runs `work` on a thread of low priority. Its argument is closed when the request has left. Fails if it panics, or if the system has
/// no more threads.
async fn on_low_thread<T: Send + 'static>(
    work: impl FnOnce(&mut oneshot::Sender<T>) -> T + Send + 'static,
) -> Result<T, Shed> {
    let (mut sender, result) = oneshot::channel();
    let run = move || {
        let made = work(&mut sender);
        // Fails if the request has left.
        let _ = sender.send(made);
    };
    start_low(Box::new(run))?;
    result.await.map_err(|_| Shed)
}

type LowWork = Box<dyn FnOnce() + Send>;

/// Threads of low priority that have nothing to do. They are kept, as many as were at work at once: a thread that starts or ends
/// changes the memory map of the process, for which all other threads wait while it has no core.
static IDLE_LOW: Mutex<Vec<mpsc::SyncSender<LowWork>>> = Mutex::new(Vec::new());

/// Starts work on a thread of low priority. Fails if the system has no thread.
fn start_low(work: LowWork) -> Result<(), Shed> {
    let idle = || IDLE_LOW.lock().unwrap_or_else(PoisonError::into_inner);
    let Some(thread) = idle().pop() else {
        let (thread, works) = mpsc::sync_channel::<LowWork>(1);
        let serve = move || {
            lower_priority();
            let mut next = Ok(work);
            while let Ok(work) = next {
                // Its request learns of a panic by the sender that is dropped.
                let _ = catch_unwind(AssertUnwindSafe(work));
                idle().push(thread.clone());
                next = works.recv();
            }
        };
        return std::thread::Builder::new().name("insula-low".to_owned()).spawn(serve).map(drop).map_err(|_| Shed);
    };
    thread.send(work).map_err(|_| Shed)
}

/// Lowers the priority of this thread and of those that it starts: beside a thread of another client, it gets a tenth of a core, and it
/// gets all of an idle one. Other systems than Linux have no priorities of threads by this call, and there the threads are equal.
fn lower_priority() {
    #[cfg(target_os = "linux")]
    if let Err(error) = rustix::process::nice(LOW_NICE) {
        tracing::debug!(%error, "the system does not lower the priority of a thread");
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use futures_util::FutureExt;

    fn ip(number: u8) -> IpAddr {
        [192, 0, 2, number].into()
    }

    fn queue(at_once: usize, waiting: usize) -> FairQueue {
        FairQueue::new(QueueLimits { at_once, waiting, at_ease: 1, max_time: Duration::from_secs(600) })
    }

    /// Enters with the requests of clients in this order.
    fn enter_all(queue: &FairQueue, clients: &[u8]) -> Vec<(u8, Option<QueuePlace>)> {
        clients.iter().map(|client| (*client, queue.enter(ip(*client)).ok())).collect()
    }

    /// Ends one running piece after the other, and returns whose they were, in the order in which they were started.
    fn order_of_service(places: Vec<(u8, Option<QueuePlace>)>) -> Vec<u8> {
        let mut waiting: Vec<(u8, QueuePlace)> =
            places.into_iter().filter_map(|(client, place)| Some((client, place?))).collect();
        let mut order = Vec::new();
        while let Some(at) = waiting.iter_mut().position(|(_, place)| place.granted.try_recv().is_ok()) {
            let (client, mut place) = waiting.remove(at);
            place.is_running = true;
            order.push(client);
            drop(place);
        }
        order
    }

    #[test]
    fn clients_take_turns_however_many_requests_they_have() {
        let queue = queue(1, 1000);
        let mut clients = vec![1; 120];
        clients.extend([2, 2, 3]);
        let order = order_of_service(enter_all(&queue, &clients));
        assert_eq!(order.len(), 123);
        assert_eq!(order[..6], [1, 1, 2, 3, 1, 2], "the first one ran already, and then all take turns");
        let state = queue.lock();
        assert!(state.clients.is_empty() && state.turns.is_empty() && state.running == 0 && state.waiting == 0);
    }

    #[test]
    fn one_client_never_has_all_running_places() {
        let queue = queue(2, 100);
        let _many = enter_all(&queue, &[1; 20]);
        assert_eq!(queue.lock().running, 1);
        let mut other = queue.enter(ip(2)).ok().unwrap();
        assert!(other.granted.try_recv().is_ok(), "it runs at once");
    }

    #[test]
    fn a_full_queue_sheds_the_newest_of_the_client_with_the_most() {
        let queue = queue(1, 4);
        let mut first = enter_all(&queue, &[1; 8]);
        let entered = |places: &[(u8, Option<QueuePlace>)]| places.iter().filter(|(_, place)| place.is_some()).count();
        assert_eq!(entered(&first), 5, "one runs, four wait, three are shed");
        let second = enter_all(&queue, &[2; 4]);
        assert_eq!(entered(&second), 2, "then both wait with two");
        let third = enter_all(&queue, &[3; 4]);
        assert_eq!(entered(&third), 1);
        assert_eq!(queue.lock().waiting, 4);
        let state = |place: &mut QueuePlace| place.granted.try_recv();
        let [running, kept @ .., last] = &mut first[..5] else { panic!("five have entered") };
        assert!(running.1.as_mut().is_some_and(|place| state(place).is_ok()));
        assert_eq!(state(last.1.as_mut().unwrap()), Err(oneshot::error::TryRecvError::Closed), "it was given up");
        assert!(
            kept.iter_mut()
                .any(|(_, place)| state(place.as_mut().unwrap()) == Err(oneshot::error::TryRecvError::Empty))
        );
        running.1.as_mut().unwrap().is_running = true;
        drop((first, second, third));
        assert!(queue.lock().clients.is_empty());
    }

    #[tokio::test]
    async fn work_that_panics_fails_alone_and_frees_its_place() {
        let queue = queue(2, 2);
        assert_eq!(queue.run(ip(1), |_| panic!("a fault")).await, Err::<(), Shed>(Shed));
        assert_eq!(queue.run(ip(1), |_| 1).await, Ok(1));
        assert_eq!(queue.wait_for(ip(1), async { 2 }).await, Ok(2));
        assert!(queue.lock().clients.is_empty());
    }

    #[tokio::test]
    async fn work_without_a_place_ends_at_its_limit_and_leaves_the_queue() {
        let limits = QueueLimits { at_once: 0, waiting: 1, at_ease: 1, max_time: Duration::from_millis(1) };
        let queue = FairQueue::new(limits);
        assert_eq!(queue.run(ip(1), |_| 1).await, Err(Shed));
        assert!(queue.lock().clients.is_empty());
    }

    #[tokio::test]
    async fn work_of_a_request_that_has_left_is_told_to_stop() {
        let queue = queue(1, 1);
        let (started, starts) = oneshot::channel();
        let (ended, ends) = oneshot::channel();
        let mut request = Box::pin(queue.run(ip(1), |stop| {
            let _ = started.send(());
            while !stop.is_stopped() {
                std::thread::yield_now();
            }
            let _ = ended.send(());
        }));
        assert!(request.as_mut().now_or_never().is_none());
        tokio::select! {
            _ = &mut request => panic!("it ends only when it is told to"),
            _ = starts => {}
        }
        drop(request);
        ends.await.unwrap();
    }

    /// The nice value of this thread.
    #[cfg(target_os = "linux")]
    fn nice() -> i32 {
        rustix::process::getpriority_process(None).unwrap()
    }

    #[cfg(target_os = "linux")]
    #[tokio::test]
    async fn work_of_a_client_that_asks_for_much_has_low_priority() {
        let (queue, own) = (queue(3, 100), nice());
        let low = (own + LOW_NICE).min(19);
        assert_eq!(queue.run(ip(1), |_| nice()).await, Ok(own), "alone");
        assert_eq!(queue.wait_for(ip(1), async { nice() }).await, Ok(own));
        let other = queue.enter(ip(1)).ok().unwrap();
        assert_eq!(queue.run(ip(1), |_| nice()).await, Ok(low), "beside another one");
        assert_eq!(queue.wait_for(ip(1), async { nice() }).await, Ok(low));
        assert_eq!(queue.run(ip(2), |_| nice()).await, Ok(own), "of another client");
        assert_eq!(queue.wait_for(ip(1), async { panic!("a fault") }).await, Err::<(), Shed>(Shed));
        drop(other);
        assert_eq!(queue.run(ip(1), |_| nice()).await, Ok(own), "threads of others were not lowered");
        assert_eq!(nice(), own);
        assert!(queue.lock().clients.is_empty());
    }

    #[tokio::test]
    async fn threads_of_low_priority_are_used_again() {
        let mut threads = std::collections::HashSet::new();
        for _ in 0..50 {
            assert_eq!(on_low_thread(|_| -> () { panic!("on purpose") }).await, Err(Shed));
            threads.insert(on_low_thread(|_| std::thread::current().id()).await.unwrap());
        }
        assert!(threads.len() < 50, "{}", threads.len());
    }

    #[tokio::test]
    async fn waiting_of_low_priority_ends_with_its_request() {
        let queue = queue(3, 100);
        let other = queue.enter(ip(1)).ok().unwrap();
        let (mut left, leaves) = oneshot::channel::<()>();
        let (started, starts) = oneshot::channel();
        let mut request = Box::pin(queue.wait_for(ip(1), async move {
            let _leaves = leaves;
            let _ = started.send(());
            std::future::pending::<()>().await;
        }));
        tokio::select! {
            _ = &mut request => panic!("it never ends"),
            _ = starts => {}
        }
        drop(request);
        left.closed().await;
        drop(other);
        while !queue.lock().clients.is_empty() {
            tokio::task::yield_now().await;
        }
    }
}
