//! Whether the stamps of two topics are of one clock.

/// Stamps of one clock are received sooner than this, or as late as one another \[ns\].
const CLOCKS_AGREE: i64 = 2_000_000_000;

/// The stamps of a topic beside the times at which its messages were received \[ns\].
#[derive(Clone, Copy, Default)]
pub(super) struct Clock {
    stamps: Option<Span>,
    received: Option<Span>,
    /// Least of the times from a stamp to the receipt.
    delay: Option<i64>,
}

impl Clock {
    pub(super) fn add(&mut self, stamp: i64, received: i64) {
        self.stamps = Span::with(self.stamps, stamp);
        self.received = Span::with(self.received, received);
        let delay = received.saturating_sub(stamp);
        self.delay = Some(self.delay.map_or(delay, |least| least.min(delay)));
    }

    /// Least of the times from a stamp to the receipt \[ns\].
    pub(super) fn delay(&self) -> i64 {
        self.delay.unwrap_or(0)
    }

    /// How long the topic was told, by whichever of its times tells of more \[ns\].
    pub(super) fn span(&self) -> i64 {
        [self.stamps, self.received].into_iter().flatten().map(Span::length).max().unwrap_or(0)
    }

    /// Whether the stamps ever change.
    fn runs(&self) -> bool {
        self.stamps.is_some_and(|stamps| stamps.length() > 0)
    }

    /// Whether the times of receipt are those of a drive: a program that writes a bag may number its messages instead.
    fn receipt_runs(&self) -> bool {
        let stamped = self.stamps.map_or(0, Span::length);
        self.received.is_some_and(|received| received.length() > 0 && received.length() >= stamped / 2)
    }

    /// How far two clocks are apart \[ns\], where stamps by them cannot be compared but times of receipt can.
    pub(super) fn differs_from(&self, other: &Self) -> Option<i64> {
        let apart = self.delay?.saturating_sub(other.delay?);
        let comparable = self.runs() && other.runs() && apart.unsigned_abs() <= CLOCKS_AGREE.unsigned_abs();
        (!comparable && self.receipt_runs() && other.receipt_runs()).then_some(apart)
    }
}

/// The least and the greatest of some times \[ns\].
#[derive(Clone, Copy)]
struct Span(i64, i64);

impl Span {
    fn with(span: Option<Self>, time: i64) -> Option<Self> {
        Some(span.map_or(Self(time, time), |Self(least, greatest)| Self(least.min(time), greatest.max(time))))
    }

    const fn length(self) -> i64 {
        self.1.saturating_sub(self.0)
    }
}
