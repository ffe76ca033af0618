//! Faults of a link, as middleware: what passes through may come out damaged, lost, or not for a while.

use lrfslam_core::math::uniform;
use lrfslam_core::time::{Duration, Instant};
use rand_core::Rng as _;
use rand_pcg::Pcg32;

/// How often what goes wrong.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct FaultPlan {
    /// Chance that one write is damaged, 0–1.
    pub damage: f32,
    /// From one unplugging to the next; zero for never.
    pub unplug_every: Duration,
    /// How long it stays unplugged.
    pub unplugged_for: Duration,
}

impl FaultPlan {
    /// Reads `none`, or a list such as `damage=0.01,unplug=20`: chance per write, seconds between unpluggings.
    ///
    /// # Errors
    /// A text that says what would be right.
    pub fn parse(text: &str) -> Result<Self, String> {
        let mut plan = Self { unplugged_for: Duration::from_millis(1500), ..Self::default() };
        for part in text.split(',').filter(|part| !part.is_empty() && *part != "none") {
            let (name, value) = part.split_once('=').unwrap_or((part, ""));
            let number: f64 =
                value.parse().map_err(|_| format!("{part}: expected NAME=NUMBER, such as damage=0.01"))?;
            match name {
                "damage" if (0.0..=1.0).contains(&number) => plan.damage = number as f32,
                "unplug" if number > 0.0 => plan.unplug_every = Duration::from_micros((number * 1e6) as i64),
                _ => return Err(format!("{part}: expected damage=CHANCE (0 to 1) or unplug=SECONDS")),
            }
        }
        Ok(plan)
    }

    /// True while the plug is out, for a session that began at zero.
    pub fn is_unplugged(&self, now: Instant) -> bool {
        let period = self.unplug_every.micros;
        period > 0 && now.micros >= period && now.micros % period < self.unplugged_for.micros
    }
}

/// One kind of damage.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Fault {
    /// One bit is flipped.
    Flip,
    /// One byte is missing.
    Lose,
    /// One byte comes twice.
    Double,
    /// One byte comes that was not sent.
    Insert,
    /// Nothing of it comes, nor of what follows for up to half a second.
    Silence,
}

/// Damages writes on their way, at most once each, by a seeded plan.
#[derive(Debug)]
pub struct FaultLink {
    chance: f32,
    rng: Pcg32,
    silent_until: Instant,
    faults: u32,
}

impl FaultLink {
    /// `chance` of damage per write, 0–1.
    pub fn new(chance: f32, seed: u64) -> Self {
        Self { chance, rng: Pcg32::new(seed, 0xFA17), silent_until: Instant::from_micros(i64::MIN), faults: 0 }
    }

    /// Passes one write.
    pub fn pass(&mut self, now: Instant, mut bytes: Vec<u8>) -> Vec<u8> {
        if now < self.silent_until {
            self.faults += 1;
            return Vec::new();
        }
        if bytes.is_empty() || uniform(&mut self.rng) >= self.chance {
            return bytes;
        }
        self.faults += 1;
        let fault = self.draw();
        let at = (uniform(&mut self.rng) * bytes.len() as f32) as usize % bytes.len();
        match fault {
            Fault::Flip => bytes[at] ^= 1 << (self.rng.next_u32() % 8),
            Fault::Lose => {
                bytes.remove(at);
            }
            Fault::Double => bytes.insert(at, bytes[at]),
            Fault::Insert => bytes.insert(at, self.rng.next_u32() as u8),
            Fault::Silence => {
                let length = (uniform(&mut self.rng) * 500_000.0) as i64;
                self.silent_until = now + Duration::from_micros(length);
                bytes.clear();
            }
        }
        bytes
    }

    /// True if a write passes undamaged, for who has no bytes to send.
    pub fn passes(&mut self, now: Instant) -> bool {
        let before = self.faults;
        self.pass(now, vec![0]);
        self.faults == before
    }

    fn draw(&mut self) -> Fault {
        match self.rng.next_u32() % 10 {
            0..=3 => Fault::Flip,
            4 | 5 => Fault::Lose,
            6 => Fault::Double,
            7 | 8 => Fault::Insert,
            _ => Fault::Silence,
        }
    }

    /// Writes damaged or lost so far.
    pub fn faults(&self) -> u32 {
        self.faults
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn chance_is_kept_and_seed_repeats() {
        let run = |seed| {
            let mut link = FaultLink::new(0.1, seed);
            let out: Vec<Vec<u8>> =
                (0..2000).map(|write| link.pass(Instant::from_micros(write * 1_000_000), vec![5; 20])).collect();
            (link.faults(), out)
        };
        let (faults, out) = run(3);
        assert!((150..250).contains(&faults), "{faults}");
        assert_eq!(run(3).1, out);
        assert_ne!(run(4).1, out);
    }

    #[test]
    fn plan_is_read_and_unplugs_in_time() {
        let plan = FaultPlan::parse("damage=0.01,unplug=20").unwrap();
        let at = |ms: i64| Instant::from_micros(ms * 1000);
        assert_eq!(
            [at(0), at(19_999), at(20_000), at(21_499), at(21_500)].map(|now| plan.is_unplugged(now)),
            [false, false, true, true, false]
        );
        assert!(FaultPlan::parse("damage=2").is_err() && FaultPlan::parse("flip").is_err());
        assert_eq!(FaultPlan::parse("none").unwrap().damage, 0.0);
    }
}
