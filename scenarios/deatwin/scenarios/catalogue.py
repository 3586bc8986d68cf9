"""The stories that deatwin brings, as its entry point of the group ``deatwin.scenarios`` offers them."""

from __future__ import annotations

from deatwin.studies.stories import Story

STORIES = (
    Story(
        name="vhb4910",
        minutes=2,
        module="deatwin.scenarios.vhb4910",
        line="measured pulls of VHB 4910: a hyperelastic strip lacks a relaxation",
    ),
    Story(
        name="silverbox",
        minutes=1.5,
        module="deatwin.scenarios.real_physics.silverbox",
        line="a measured oscillator, described as linear: the cubic spring is found",
    ),
    Story(
        name="emps",
        minutes=1.5,
        module="deatwin.scenarios.real_physics.emps",
        line="a measured drive in closed loop, described with viscous friction: dry friction is found",
    ),
    Story(
        name="cascaded-tanks",
        minutes=1,
        module="deatwin.scenarios.real_physics.cascaded_tanks",
        line="two measured tanks, described without their brim: the overflow is found",
    ),
    Story(
        name="bouc-wen",
        minutes=2,
        module="deatwin.scenarios.real_physics.bouc_wen",
        line="the Bouc-Wen benchmark, described as linear: the hysteresis is found",
    ),
    Story(
        name="grey-boxes",
        minutes=2,
        module="deatwin.scenarios.real_physics.grey_boxes",
        line="tanks, EMPS in open loop and Bouc-Wen: plants with all documented physics, calibrated",
    ),
    Story(
        name="standard-tasks",
        minutes=4,
        module="deatwin.scenarios.real_physics.standard_tasks",
        line="the field's standard tasks in one table: Silverbox, tanks, EMPS in open loop, Bouc-Wen",
    ),
    Story(
        name="your-own-rig",
        minutes=0.5,
        module="deatwin.scenarios.your_own_rig",
        line="a user's plant of thirty lines, a quarter-car model: its missing drag is found",
    ),
    Story(
        name="thesis-data",
        minutes=0.5,
        module="deatwin.scenarios.thesis_data",
        line="the thesis' six actuators: recordings, drifts, figures 2.5 to 2.8",
    ),
    Story(
        name="semp-fleet",
        minutes=0.8,
        module="deatwin.scenarios.fleet_models.semp_fleet",
        line="the six actuators identified and validated by SEMP and FRO; effects of drift and hysteresis",
    ),
    Story(
        name="svb-fleet",
        minutes=0.8,
        module="deatwin.scenarios.fleet_models.svb_fleet",
        line="the six actuators by sparse variational Bayes: posteriors and bands, compared with SEMP",
    ),
    Story(
        name="prestretch-sweep",
        minutes=0.3,
        module="deatwin.scenarios.prestretch",
        line="prestretch: ten claims about its effects, each tested with numbers",
    ),
    Story(
        name="svb-benchmark",
        minutes=8,
        module="deatwin.scenarios.svb_benchmark",
        resumes=True,
        line="how often the true NARX structure is found: all methods on systems whose equations are known",
    ),
    Story(
        name="frequency-analysis",
        minutes=1.5,
        module="deatwin.scenarios.frequency_analysis",
        line="frequency responses of all orders and NOFRFs: known systems, then the six actuators",
    ),
    Story(
        name="time-varying",
        minutes=1.2,
        module="deatwin.scenarios.time_varying",
        line="parameters that vary in time: known systems, then the drifts of the six actuators and their spectra",
    ),
    Story(
        name="frequency-uncertainty",
        minutes=1.5,
        module="deatwin.scenarios.frequency_uncertainty",
        line="uncertainty of frequency responses; differences between six actuators, and how consistent fabrication is",
    ),
    Story(
        name="regression-lessons",
        minutes=0.5,
        module="deatwin.scenarios.regression_lessons",
        line="ridge and LASSO constraints, bias and variance, Occam's razor: each lesson with a check",
    ),
    Story(
        name="concealed-physics",
        minutes=240,
        module="deatwin.scenarios.concealed_physics",
        sizes=("tiny", "long", "standard", "full"),
        times=(5, 150, 240, 480),
        resumes=True,
        line="a test of the diagnosis: it must find effects that are concealed in sealed cases",
    ),
    Story(
        name="unexplained-drift",
        minutes=5,
        module="deatwin.scenarios.unexplained_drift",
        resumes=True,
        line="six actuators with concealed drifts: what the diagnosis names, and what repeatability proves",
    ),
    Story(
        name="control-check",
        minutes=3,
        module="deatwin.scenarios.control_check",
        sizes=("short", "standard", "full"),
        times=(3, 15, 55),
        resumes=True,
        line="reliability of the control check on unknown rigs, and the benefit of an inverse",
    ),
    Story(
        name="real-data",
        minutes=1,
        module="deatwin.scenarios.real_data",
        line="free runs on public recordings: Silverbox, buck converter, cascaded tanks, EMPS",
    ),
)
