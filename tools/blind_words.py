"""What the benchmark's page says about how it was made."""

__all__ = ["HOW", "LIMITS", "METRICS"]

HOW = """## How it is made

`tests/blind/injector` is a bench of its own: servo, shaft and load are integrated at 10 kHz and
sampled at 1 kHz behind a converter of 12 or 16 bit, a counting or an interpolated encoder and a
tacho; zero, ripple, misalignment and servo differ from record to record. It imports nothing of
hdbench, nor hdbench of it (a test holds both to that). Effects have forms of their own: arctangents
for smooth signs, Bouc and Wen loops for hysteresis and presliding, algebraic knees for saturation
(of the whole channel, ripple and zero too), knees of a spring at ratios off any catalogue,
resonators and relaxation integrated in time, parameters off any grid.

| record | what it holds |
|---|---|
| constant | 40 s at one speed |
| mixed | 60 s: staircase both ways, sweeps, sines of the speed, rest; no load |
| short | 60 s: as mixed, under 12 and -25 N m, locked at 20 N m at four angles, slow reversals |
| compact | 28 s: the same with three speeds and three angles |
| protocol | 172 s: the same with nine speeds and longer stretches |
| long | 600 s: with a load that hangs for 170 s |

Noise of 0.01, 0.05 or 0.2 N m is white, AR(0.9), or rises like 1/f below 100 Hz. Sizes in sigmas
are set on the very record: the effect whitened by the true noise, less what the baseline and the
effect's own shape parameters can take. Sizes of part P are physical. `--materiality 0` where sizes
are in sigmas, the default elsewhere.

The truth of every case is sealed by SHA-256 before the first diagnosis, that of a record (size,
bound, group) before its own; only the scorer opens it, and it checks the seal. The true group are
the names whose effect spans the same space on that record (sine squared below 0.01), from the
injector's signatures. `make blind` runs it all; `tools/blind.py --fresh` takes seeds from commit
and date. Cells (part, size, noise) are spread evenly over the list and families taken in turn, so
that a campaign that ends early has the same share of every figure.

**Part T** hides three to five causes of physical size (between the low and the high size of part P)
on one record, from groups of effects whose pairs all come up in turn. Each has 10 sigma or more
beside all others and their shapes, and no name of one spans another there; what does not fit is
replaced by the next of the list. Default `--materiality`.

**Part W** is pairs of records of one seed: a third clean, the others with one or two effects, sound
and with one to four nuisances drawn at random. The size of an effect is set so that the smaller of
its sigmas on both is 12, 20 or 40. Sigmas on a rough record are what the effect's own form, on the
channels of the log, catches of it under the spectrum of the log's noise; names that catch as much
are one group there. `--materiality 0`.

| nuisance | drawn from |
|---|---|
| output-encoder | angle = output encoder x ratio: transmission error of 0.5 to 3 mrad, compliance |
| velocity | differences of the angle, or the drive's filter: delay 2 to 20 ms, 12 bit |
| false-stamps | even stamps on intervals that vary by 10 to 40 % |
| held | 1 to 5 % of the rows, or of the torque samples, repeat the one before |
| gaps | two to six of 2 to 30 ms, with and without stamps |
| low-pass | torque (and load channel) at 5 to 200 Hz, causal or zero-phase |
| speed-ripple | a velocity loop of 8 to 25 Hz that gives way to the torque, 0.1 to 0.6 rad/s |
| gain, inertia | torque off by 5 to 15 %, inertia by 10 to 30 % |
| transients | decaying oscillations of 1 to 4 sigma at every start and stop |
| rate | 50 to 500 Hz, with and without a filter against aliases |

**Part U** is a composer: a random Fourier series, kink, square root, threshold or exponential of
speed, its size, time, output angle, motor angle, load or acceleration, or of two of them, or an
order with such an envelope, or bursts. The part that no catalogue name imitates has 10 or 20 sigma,
unless a name spans the effect; of bursts the strongest has them.

**Real** are records that others measured (`HDBENCH_DATA`), with what is known of each; values of
the profile come from there too.
"""

METRICS = """## Definitions

* False alarm: a clean record with a cause or an unexplained place of any size.
* Counts in brackets: what a tool at the pass level breaks in 0.2 % of campaigns; a figure beyond
  its level but inside the count is "missed, within chance".
* Detection: any cause, unexplained place or flag of that fault. Exact: as many causes as effects,
  each reported set (name, group, rivals) inside the true group, nothing unexplained beside.
* The first name is right: its own group is the true one, with any rivals beside it. Levels of
  other tools that always say one name are of this kind.
* In the set: the reported set of some cause holds the true group. Wrong without rivals: no
  set holds it and some cause stands without rivals.
* Gain: share of the baseline's held-out variance that the extended model explains, over the
  same of the oracle: the true effect, its shape to first order, exact motion, the true noise.
* Parameters: where injected and fitted forms agree; error over the record's Cramer-Rao bound.
* Phantom: a cause whose set holds no hidden effect.
* Outside: unexplained in the effect's domain, or a name with a free order at that order, where the
  part that no catalogue entry imitates has 7 sigma or more. Near miss: where it has less than 4;
  right is a name with rivals or an unexplained rest, not silence.
* Duels: two effects that look alike, on a record that cannot separate them and on one that can.
  On the first, right is both names in one set and a proposed run that separates them: the run is
  driven on the injector's bench, and one effect, as large as it was hidden, must stay 4.65 sigmas
  from the other (1 % wrong names).
* Bad data: told by its own name, where a cause or a flag names that very fault; causes beside it.
* Two effects: pairs whose true groups are one and the same on their record are one effect there,
  and are left out.
* P(name): the `probability` that is told with the first name. Calibration error in tenths; Brier
  score beside it.
* S: mean over parts B to E of 1 exact, 0.5 in a set of at most 3, -1 wrong without rivals, 0
  otherwise; less 5 times the false-alarm rate above 1 %.
* Time: seconds of one core, record in memory to answer.
* T: named, where the true group is in the reported set of a cause of its own (or of a minor one)
  and a line stands at its order or frequency. Whole record right: all named, no other cause, no
  unexplained place. A rest that is not told: held-out error 10 % above the noise, and nothing
  unexplained of half its size (`rest` of the answer where it has one).
* W: detection and names as in T, on pairs whose effects have 10 sigma on both records. Causes under
  the catalogue's own name of a nuisance count neither way; nor do unexplained moments where starts
  and stops ring. Refused: no answer, or `data-bad`.
* U: right, where the table of an axis (or pair of axes) that is told as unexplained spans .95 of
  the effect on this record, or the signatures of a reported name or of two do.
* Intervals of T and W (both records of a pair): value within 1.96 stated standard deviations; sizes
  only where no nuisance scales what stands in the channel.
* Real: orders within .1, amplitudes within 3 standard deviations and 10 %, in a cause or in the
  fitted baseline; parameters within 3 combined standard deviations. Held out: error in per cent of
  the torque without and with the cause that tells the directions apart.
"""

LIMITS = """## What it does not show

`misalignment` and `load-gravity` are part of the baseline where the output turns once, and have no
records; `side-force` is `direction-asymmetry` on these records. `quantisation`, `missed-samples`,
`spikes` and `tacho-ripple` have physical sizes only. The bench sees the strain of the flexspline: a
bent spring (`cubic-stiffness`, `piecewise-stiffness`) shows as a bent torque. The simpler methods
are handed the exact motion and the injector's own columns, which favours them.
"""
