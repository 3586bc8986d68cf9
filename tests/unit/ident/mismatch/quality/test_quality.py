"""What the gate lets through, and how the held-out part is kept."""

from dataclasses import replace

import numpy as np
import pytest
from runs import blank

from deatwin.ident.mismatch.quality.quality import Soundness, check_quality, confirm, split
from deatwin.plant import DataError, Diaphragm, Experiment, ModelError, Plant, Recording
from deatwin.plant.excitation import band_limited_noise, random_holds

PLANT = Plant(rig=Diaphragm())


def with_outputs(experiment: Experiment, outputs: np.ndarray) -> Experiment:
    first, *rest = experiment.recordings
    return Experiment(recordings=(replace(first, outputs=outputs[None]), *rest))


def spoilt(experiment: Experiment, where: int | slice, by: float = 0.0, to: float | None = None) -> Experiment:
    """The same with some readings of the first record off by so much, or held at a value."""
    outputs = experiment.recordings[0].outputs[0].copy()
    outputs[where] = outputs[where] + by if to is None else to
    return with_outputs(experiment, outputs)


def median(experiment: Experiment) -> float:
    return float(np.median(experiment.recordings[0].outputs[0]))


@pytest.fixture(scope="module")
def sound():
    rng = np.random.default_rng(0)
    noise = band_limited_noise(rng, 40.0, 0.02)
    holds = random_holds(rng, 40.0, 0.02, 1.2, 3.2)
    records = (*blank(noise).recordings, *blank(holds, start=40.0).recordings)
    return PLANT.record(Experiment(recordings=records), np.random.default_rng(1))


def test_ringing_after_any_jump_is_no_outlier():
    """Twenty clean records with jumps of all sizes: none is called faulty."""
    rng = np.random.default_rng(2)
    for _ in range(20):
        holds = random_holds(rng, 60.0, 0.02, 1.1, 3.3)
        assert check_quality(PLANT, [PLANT.record(blank(holds), rng)]).soundness is Soundness.SOUND


def test_a_corner_of_the_command_makes_no_outlier():
    """Where a command that moves turns within a sample, the ball overshoots: not suspected, let alone a fault."""
    slope = np.concatenate([np.linspace(1.2, 3.2, 150), np.linspace(3.2, 1.2, 150)[1:]])
    commands = np.tile(slope, 8)
    unread = blank(commands)
    reading = PLANT.record(unread, np.random.default_rng(6)).recordings[0].outputs[0].copy()
    corner = int(np.argmax(commands[1000:])) + 1000
    reading[corner + 5] += 2e-4
    spoiled = with_outputs(unread, reading)
    assert not check_quality(PLANT, [spoiled]).outliers[0][0][corner : corner + 50].any()
    reading[corner + 80] += 2e-4
    spoiled = with_outputs(unread, reading)
    assert check_quality(PLANT, [spoiled]).outliers[0][0][corner + 80]


def test_fast_motion_is_no_outlier():
    """Limited noise of 3 Hz drives the soft nominal film into fast motion, which bends its readings on all sides."""
    rng = np.random.default_rng(5)
    for _ in range(10):
        noise = band_limited_noise(rng, 60.0, 0.02, band=3.0)
        assert not check_quality(PLANT, [PLANT.record(blank(noise), rng)]).findings


def test_a_ball_that_rings_at_every_turn_of_the_drive_is_no_outlier(sound):
    """Four samples to a period, forty noises high, swelling and dying away: its peaks are as far off as any spike."""
    outputs, after = sound.recordings[0].outputs[0].copy(), np.arange(40) / 5
    ring = 2e-4 * after * np.exp(-after) * np.sin(2 * np.pi * np.arange(40) / 4.1)
    for start in range(300, 1500, 60):
        outputs[start : start + 40] += ring
    assert not check_quality(PLANT, [with_outputs(sound, outputs)]).findings
    outputs[1650] += 2e-4
    assert np.flatnonzero(check_quality(PLANT, [with_outputs(sound, outputs)]).outliers[0][0]).tolist() == [1650]


def test_what_the_calibrated_plant_does_as_well_is_not_confirmed(sound):
    spoiled = spoilt(sound, slice(500, 600, 10), by=2e-4)
    checked = check_quality(PLANT, [spoiled])
    assert checked.outliers[0][0].sum() == 10
    assert not confirm(checked, [[record.outputs[0] for record in spoiled.recordings]]).findings


def test_a_true_outlier_is_confirmed(sound):
    spoiled = spoilt(sound, slice(500, 600, 4), by=2e-4)
    checked = confirm(check_quality(PLANT, [spoiled]), [[y[0] for y in PLANT.simulate(spoiled).outputs]])
    assert checked.soundness is Soundness.FAULTY
    assert checked.outliers[0][0].sum() >= 20


def test_a_sound_experiment_passes(sound):
    checked = check_quality(PLANT, [sound])
    assert (checked.soundness, checked.notes) == (Soundness.SOUND, ())
    assert all(mask.mean() > 0.995 for mask in checked.sound[0])


def test_a_stuck_sensor_is_a_fault_with_its_place(sound):
    checked = check_quality(PLANT, [spoilt(sound, slice(1000, 1200), to=median(sound))])
    assert checked.soundness is Soundness.FAULTY
    assert "stuck in 200 samples between 20.00 and 23.98 s" in checked.findings[0]
    assert not checked.sound[0][0][1000:1200].any()


@pytest.mark.parametrize("value", [np.median, np.max])
def test_a_stuck_sensor_is_reported_once(sound, value):
    """Where it goes back to the plant it jumps, and at its largest value it looks clipped: still one fault."""
    checked = check_quality(PLANT, [spoilt(sound, slice(1000, 1200), to=value(sound.recordings[0].outputs))])
    assert (len(checked.findings), checked.notes) == (1, ())


def test_a_lone_outlier_is_left_out_without_a_fault(sound):
    checked = check_quality(PLANT, [spoilt(sound, 700, by=2e-4)])
    assert checked.soundness is Soundness.SOUND
    assert not checked.sound[0][0][700]


def test_the_last_part_of_each_record_is_unseen(sound):
    fitted, unseen, everything = split(check_quality(PLANT, [sound]))
    for early, late, all_of_it in zip(fitted[0].masks, unseen[0].masks, everything[0].masks, strict=True):
        assert not (early & late).any()
        np.testing.assert_array_equal(early | late, all_of_it)
        assert np.flatnonzero(late)[0] == round(0.7 * late.size)


def test_an_onset_in_the_unseen_part_moves_the_split(sound):
    fitted, unseen, _ = split(check_quality(PLANT, [sound]), onset=32.0)
    # of the eight seconds after the onset the last 30 % stay unseen
    assert np.flatnonzero(unseen[0].masks[0])[0] == round((32.0 + 0.7 * 8.0) / 0.02)
    assert np.flatnonzero(unseen[0].masks[1])[0] == round(0.7 * 2000)
    assert fitted[0].masks[0][: round(37.0 / 0.02)].mean() > 0.99


def test_a_sensor_that_freezes_and_stays_frozen_leaves_an_unseen_part(sound):
    held = sound.recordings[0].outputs[0, 1300]
    checked = check_quality(PLANT, [spoilt(sound, slice(1300, None), to=held)])
    assert checked.soundness is Soundness.FAULTY
    _, unseen, _ = split(checked)
    # the sensor may have stood still for the first of these by chance; 70 % of what is sound is fitted
    assert np.flatnonzero(unseen[0].masks[0])[0] == pytest.approx(0.7 * 1300, abs=2)
    assert not unseen[0].masks[0][1301:].any()


def test_a_dead_sensor_is_a_fault_and_not_a_limit(sound):
    dead = Experiment(recordings=tuple(replace(r, outputs=np.full_like(r.outputs, 1e-4)) for r in sound.recordings))
    checked = check_quality(PLANT, [dead])
    assert checked.soundness is Soundness.FAULTY
    assert "stuck in 2000 samples" in checked.findings[0]
    fitted, unseen, _ = split(checked)  # there is nothing better to fit
    assert all(mask.any() for part in (*fitted, *unseen) for mask in part.masks)


def test_a_reading_that_is_clipped_half_of_the_time_is_not_stuck(sound):
    clipped = [replace(r, outputs=np.minimum(r.outputs, np.median(r.outputs))) for r in sound.recordings]
    assert check_quality(PLANT, [Experiment(recordings=tuple(clipped))]).soundness is Soundness.SOUND


def test_a_spike_beyond_a_limit_makes_no_clipped_reading_stuck(sound):
    outputs = sound.recordings[0].outputs[0]
    clipped = np.minimum(outputs, np.quantile(outputs, 0.8))
    clipped[700] += 1e-4
    assert not check_quality(PLANT, [with_outputs(sound, clipped)]).stuck[0][0].any()


def coarse(step: float) -> Experiment:
    """A slow triangle of the command, whose square moves the readings by 250 µm, read in steps."""
    timepts = 0.02 * np.arange(12_000)
    command = 3.2 * np.abs(timepts / 30.0 % 2.0 - 1.0)
    reading = 250e-6 * (command / 3.2) ** 2 + 0.5e-6 * np.random.default_rng(2).standard_normal(timepts.size)
    return Experiment(recordings=(Recording.from_arrays(command, step * np.round(reading / step), 0.02),))


@pytest.mark.parametrize("step", [1e-6, 5e-6, 10e-6])
def test_readings_in_coarse_steps_are_not_stuck_over_slow_commands(step):
    assert check_quality(PLANT, [coarse(step)]).soundness is Soundness.SOUND


def test_coarse_readings_can_be_stuck_too():
    sound = coarse(5e-6)
    held = sound.recordings[0].outputs[0, 2200]
    checked = check_quality(PLANT, [spoilt(sound, slice(2200, 2700), to=held)])
    assert checked.stuck[0][0][2200:2700].all()
    assert checked.stuck[0][0].sum() < 600


@pytest.mark.parametrize("value", [0.0, 5e-4])
def test_readings_that_are_lost_for_a_moment_are_left_out(sound, value):
    checked = check_quality(PLANT, [spoilt(sound, slice(700, 720), to=value)])
    assert checked.stuck[0][0][700:720].all()
    assert checked.stuck[0][0].sum() == 20


def test_a_film_that_is_sent_away_and_back_is_not_lost():
    """A square wave, read in coarse steps: the command says where the leaps come from."""
    command = 1.5 + (np.arange(6000) // 40 % 2)
    reading = 5e-6 * np.round(1e-4 * command**2 / 5e-6)
    jumpy = Experiment(recordings=(Recording.from_arrays(command, reading, 0.02),))
    assert not check_quality(PLANT, [jumpy]).stuck[0][0].any()


def test_a_dead_recording_beside_a_sound_one_is_left_out(sound):
    dead = Experiment(recordings=tuple(replace(r, outputs=np.full_like(r.outputs, 1e-4)) for r in sound.recordings))
    checked = check_quality(PLANT, [sound, dead])
    assert checked.soundness is Soundness.FAULTY
    for parts in split(checked):
        assert [part.experiment for part in parts] == [sound]


def test_a_recording_in_many_pieces_is_taken_as_a_whole(sound):
    pieces = tuple(sound.recordings[0].section(start, start + 149) for start in range(0, 1900, 150))
    assert len(check_quality(PLANT, [Experiment(recordings=pieces)]).usable[0]) == len(pieces)
    with pytest.raises(ModelError, match="100 samples, but a diagnosis needs at least 140"):  # 20 for each of 7
        check_quality(PLANT, [Experiment(recordings=(pieces[0].section(0, 100),))])


def test_the_sound_part_beside_a_long_freeze_has_no_outliers(sound):
    least = sound.recordings[0].outputs.min()
    checked = check_quality(PLANT, [spoilt(sound, slice(1400), to=least)])
    assert checked.stuck[0][0][:1400].all()
    assert checked.outliers[0][0][1410:].sum() == 0


def test_times_of_a_stretch_are_written_with_the_digits_that_tell_them_apart(sound):
    first = sound.recordings[0]
    fast = Experiment(recordings=(replace(first, sample_time=1e-3),))
    checked = replace(check_quality(PLANT, [Experiment(recordings=(first,))]), experiments=(fast,))

    def said(*marked: int) -> str:
        mask = np.isin(np.arange(first.n_samples), marked)
        (note,) = [n for n in replace(checked, clipped=((mask,),)).notes if "at its limit" in n]
        return note.partition(" limit in ")[2]

    assert said(502, 503) == "2 samples between 0.502 and 0.503 s"
    assert said(100, 502, 503) == "3 samples: 0.10 s, 0.502 to 0.503 s"
    assert said(100, 101, 110, 1500) == "4 samples: 0.100 to 0.101 s, 0.11 s, 1.50 s"


def test_limits_jumps_steps_and_gaps_are_reported_but_no_faults(sound):
    first, second = sound.recordings
    clipped = np.minimum(first.outputs, np.quantile(first.outputs, 0.8))
    given = Experiment(recordings=(replace(first, outputs=clipped), replace(second, start=second.start + 3.0)))
    assert check_quality(PLANT, [given]).soundness is Soundness.SOUND
    notes = check_quality(PLANT, [given]).notes
    assert notes[0].startswith("record 1: the reading stays at its limit in ")
    assert "no readings between 40.00 and 43.00 s" in notes[-1]
    coarse = np.round(first.outputs[0] / 8e-6) * 8e-6
    checked = check_quality(PLANT, [with_outputs(sound, coarse)])
    assert checked.soundness is Soundness.SOUND
    assert "record 1: the readings are quantised in steps of 8 µm" in checked.notes
    jumped = first.outputs[0] - 3e-4 * (np.arange(2000) >= 1200)
    jumps = [note for note in check_quality(PLANT, [with_outputs(sound, jumped)]).notes if "jumps" in note]
    assert jumps == ["record 1: the reading jumps in one sample at 24.00 s"]


def test_a_jump_is_confirmed_by_the_residual(sound):
    jumped = spoilt(sound, slice(1200, None), by=-3e-4)
    checked = confirm(check_quality(PLANT, [jumped]), [[y[0] for y in PLANT.simulate(jumped).outputs]])
    assert np.flatnonzero(checked.jumps[0][0]).tolist() == [1200]


def test_the_gate_draws_what_it_found(sound):
    axes = check_quality(PLANT, [spoilt(sound, slice(1000, 1200), to=median(sound))]).plot()
    assert axes.get_ylabel() == "reading (µm)"
    assert "stuck, 200 samples" in [text.get_text() for text in axes.get_legend().get_texts()]


@pytest.mark.parametrize(
    ("given", "said"),
    [
        (lambda sound: (), "no recording was given"),
        (lambda sound: Recording.from_arrays(np.full(3000, 2.0), np.zeros(3000), 0.02), "constant"),
        (lambda sound: None, "experiment 1 is a NoneType, neither an Experiment nor a Recording: .*from_arrays"),
        (lambda sound: [sound, sound.recordings[0].outputs], "experiment 2 is a ndarray"),
        (lambda sound: replace(sound.recordings[0], input_units=("A",)), "is in A, but the model needs it in V"),
    ],
)
def test_what_are_no_experiments_is_said(sound, given, said):
    with pytest.raises(DataError, match=said):
        check_quality(PLANT, given(sound))


def test_a_single_recording_starts_from_rest(sound):
    """As in `Plant.simulate`: alone, or beside experiments."""
    first, second = sound.recordings
    for given in (second, [sound, second]):
        checked = check_quality(PLANT, given)
        assert checked.experiments[-1].recordings == (second,)
    alone, as_experiment = (check_quality(PLANT, one) for one in (first, Experiment(recordings=(first,))))
    assert alone.findings == as_experiment.findings and alone.soundness is as_experiment.soundness


def turning(command: np.ndarray, friction: float) -> np.ndarray:
    """Speed of a rotor with dry friction as a counter reads it, rad/s: 0.1 s of inertia, steps of a millisecond."""
    speed, counted = 0.0, np.zeros(command.size)
    for k, drive in enumerate(command):
        counted[k] = 0.05 * np.round(speed / 0.05)
        for _ in range(50):
            if speed == 0.0 and abs(drive) <= friction:
                break
            way = np.sign(speed) or np.sign(drive)
            new = speed + 1e-3 * (drive - speed - friction * way) / 0.1
            speed = 0.0 if speed * new < 0.0 else new
    return counted


STAIRS = np.repeat([0, 0.5, 1, 1.5, 0, -1, -1.5, 0, 3, 5, 8, 0, 1.2, -4, -8, 0, 1, 6, -6, 0, -1.2, 4.0], 60)


def test_a_motor_that_friction_holds_is_not_stuck():
    """A counter of a motor that stands has no noise: it stands still for 25 s under commands of a fifth of the range."""
    recorded = Recording.from_arrays(STAIRS, turning(STAIRS, 1.8), 0.05)
    checked = check_quality(PLANT, [Experiment(recordings=(recorded,))])
    assert (np.diff(recorded.outputs[0][:480]) == 0.0).all()
    assert not checked.stuck[0][0].any()


def sticking(drag: np.ndarray, step: float) -> np.ndarray:
    """Place of a slider on a spring of 10 Hz that is dragged over a rough table, as a counter of one per `step` reads it.

    It sticks until the spring is stretched by 1, slides against 0.6 of it, and is damped lightly.
    """
    place, speed, omega, inner, found = 0.0, 0.0, 2 * np.pi * 10.0, 40, np.zeros(drag.size)
    for k, end in enumerate(drag):
        for _ in range(inner):
            pull = end - place
            if speed == 0.0 and abs(pull) <= 1.0:
                break
            way = np.sign(speed) or np.sign(pull)
            new = speed + 0.02 / inner * (omega**2 * (pull - 0.6 * way) - 0.4 * omega * speed)
            speed = 0.0 if speed * new < 0.0 else new
            place += 0.02 / inner * speed
        found[k] = step * np.round(place / step)
    return found


def test_a_slider_that_sticks_and_slips_is_not_stuck():
    """Of ten draws of a slow drag, under which it stands for seconds and then leaps, nine have no part that is called stuck."""
    stood, sound = [], 0
    for seed in range(10):
        rng = np.random.default_rng(seed)
        timepts = 0.02 * np.arange(6000)
        drag = np.interp(timepts, np.arange(0.0, 130.0, 10.0), 8.0 * rng.uniform(-1.0, 1.0, 13))
        place = sticking(drag, rng.choice([0.02, 0.05, 0.1]))
        stood.append(max(np.diff(np.flatnonzero(np.diff(place)))) * 0.02)
        given = [Experiment(recordings=(Recording.from_arrays(drag, place, 0.02),))]
        sound += not check_quality(PLANT, given).stuck[0][0].any()
    assert min(stood) > 1.0
    assert sound >= 9


def test_a_slider_whose_counter_stands_still_is_stuck():
    """In ten draws: eight seconds in which it slips four times or more, in nine at least."""
    found = []
    for seed in range(10):
        rng = np.random.default_rng(seed)
        drag = np.interp(0.02 * np.arange(6000), np.arange(0.0, 130.0, 10.0), np.tile([8.0, -8.0], 7)[:13])
        place = sticking(drag, 0.05)
        first = int(rng.integers(1000, 5000))
        place[first : first + 400] = place[first]
        stuck = check_quality(PLANT, [Experiment(recordings=(Recording.from_arrays(drag, place, 0.02),))]).stuck[0][0]
        found.append(stuck[first : first + 400].all() and stuck.sum() < 700)
    assert sum(found) >= 9


def test_a_hold_is_stuck_however_short_where_noise_is_alive(sound):
    """Fifteen equal readings up to a leap: noise of many levels is equal to its neighbour once in as many."""
    outputs = sound.recordings[0].outputs[0].copy()
    first = int(np.argmax(np.abs(outputs[15:] - outputs[:-15])))
    outputs[first : first + 15] = outputs[first]
    found = check_quality(PLANT, [with_outputs(sound, outputs)]).stuck[0][0]
    assert np.flatnonzero(found).tolist() == list(range(first, first + 15))


def test_a_counter_that_stands_still_where_the_motor_turns_is_stuck():
    """Without friction, though it repeats with the command; with friction, though at no leap of the command."""
    free = turning(STAIRS, 0.0)
    free[120:300] = free[119]
    held = turning(STAIRS, 1.8)
    held[500:575] = held[499]
    for counted, still in ((free, slice(120, 300)), (held, slice(500, 575))):
        record = Recording.from_arrays(STAIRS, counted, 0.05)
        assert check_quality(PLANT, [Experiment(recordings=(record,))]).stuck[0][0][still].all()
