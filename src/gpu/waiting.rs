//! Waiting for what a device answers.

#[cfg(target_family = "wasm")]
pub(super) use in_browser::{answered, block_on, wake};
#[cfg(not(target_family = "wasm"))]
pub(super) use on_thread::{answered, block_on, wake};

#[cfg(not(target_family = "wasm"))]
mod on_thread {
    use std::sync::mpsc::Receiver;
    use std::time::Duration;

    pub use pollster::block_on;

    /// A submission that takes longer will never end: those of ten million particles take seconds.
    const PATIENCE: Duration = Duration::from_secs(120);

    /// Waits until the device is done with all that it was given. Returns what came by then.
    pub fn answered<T>(device: &wgpu::Device, receiver: &Receiver<T>) -> Result<Option<T>, wgpu::PollError> {
        device.poll(wgpu::PollType::Wait { submission_index: None, timeout: Some(PATIENCE) })?;
        Ok(receiver.try_recv().ok())
    }

    /// An answer has come: on a thread that waits for the device nothing more is due.
    pub fn wake() {}
}

/// The page's worker has one thread, and promises are kept only while it rests: `rest` suspends the program with its stack.
#[cfg(target_family = "wasm")]
mod in_browser {
    use std::pin::pin;
    use std::sync::Arc;
    use std::sync::mpsc::{Receiver, TryRecvError};
    use std::task::{Context, Poll, Wake, Waker};
    use wasm_bindgen::prelude::wasm_bindgen;

    #[wasm_bindgen(module = "/src/gpu/waiting.js")]
    extern "C" {
        /// Suspends the program until the next [`wake`].
        fn rest();

        /// An answer has come.
        pub fn wake();
    }

    struct Woken;

    impl Wake for Woken {
        fn wake(self: Arc<Self>) {
            wake();
        }
    }

    /// Runs a future to its end.
    pub fn block_on<F: Future>(future: F) -> F::Output {
        let waker = Waker::from(Arc::new(Woken));
        let mut context = Context::from_waker(&waker);
        let mut future = pin!(future);
        loop {
            match future.as_mut().poll(&mut context) {
                Poll::Ready(output) => return output,
                Poll::Pending => rest(),
            }
        }
    }

    /// Waits until the answer has come.
    pub fn answered<T>(_: &wgpu::Device, receiver: &Receiver<T>) -> Result<Option<T>, wgpu::PollError> {
        loop {
            match receiver.try_recv() {
                Err(TryRecvError::Empty) => rest(),
                answer => return Ok(answer.ok()),
            }
        }
    }
}
