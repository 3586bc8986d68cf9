"""List of the scenarios that deatwin offers by its entry point in the group ``deatwin.scenarios``."""

from __future__ import annotations

from deatwin.studies.stories import Story

STORIES = (
    Story(
        name="vhb4910",
        minutes=2,
        module="deatwin.scenarios.vhb4910",
        line="finds the relaxation that a hyperelastic model of measured VHB 4910 lacks",
    ),
    Story(
        name="silverbox",
        minutes=1.5,
        module="deatwin.scenarios.real_physics.silverbox",
        line="finds the cubic spring that a linear model of a measured oscillator lacks",
    ),
    Story(
        name="emps",
        minutes=1.5,
        module="deatwin.scenarios.real_physics.emps",
        line="finds the dry friction that a model of a measured drive in closed loop lacks",
    ),
    Story(
        name="cascaded-tanks",
        minutes=1,
        module="deatwin.scenarios.real_physics.cascaded_tanks",
        line="finds the overflow that a model of two measured tanks lacks",
    ),
    Story(
        name="bouc-wen",
        minutes=2,
        module="deatwin.scenarios.real_physics.bouc_wen",
        line="finds the hysteresis that a linear model of the Bouc-Wen benchmark lacks",
    ),
    Story(
        name="grey-boxes",
        minutes=2,
        module="deatwin.scenarios.real_physics.grey_boxes",
        line="calibrates complete physical models of the tanks, EMPS in open loop and Bouc-Wen",
    ),
    Story(
        name="standard-tasks",
        minutes=4,
        module="deatwin.scenarios.real_physics.standard_tasks",
        tasks=("silverbox", "cascaded-tanks", "emps", "bouc-wen"),
        line="fits models to four standard tasks of the field: Silverbox, tanks, EMPS in open loop, Bouc-Wen",
    ),
    Story(
        name="your-own-rig",
        minutes=0.5,
        module="deatwin.scenarios.your_own_rig",
        line="finds a drag that a user's plant of thirty lines, a quarter-car model, lacks",
    ),
    Story(
        name="thesis-data",
        minutes=0.5,
        module="deatwin.scenarios.thesis_data",
        line="simulates the thesis' six actuators: recordings, drifts, figures 2.5 to 2.8",
    ),
    Story(
        name="semp-fleet",
        minutes=0.8,
        module="deatwin.scenarios.fleet_models.semp_fleet",
        line="identifies the six actuators by SEMP and FROLS, and shows the errors caused by drift and hysteresis",
    ),
    Story(
        name="svb-fleet",
        minutes=0.8,
        module="deatwin.scenarios.fleet_models.svb_fleet",
        line="identifies the six actuators by sparse variational Bayes, with posteriors and bands, and compares with SEMP",
    ),
    Story(
        name="prestretch-sweep",
        minutes=0.3,
        module="deatwin.scenarios.prestretch",
        line="tests eleven claims about the effects of prestretch",
    ),
    Story(
        name="svb-benchmark",
        minutes=8,
        module="deatwin.scenarios.svb_benchmark",
        resumes=True,
        line="measures how often each method finds the true NARX structure of systems whose equations are known",
    ),
    Story(
        name="frequency-analysis",
        minutes=1.5,
        module="deatwin.scenarios.frequency_analysis",
        line="computes frequency responses of all orders and NOFRFs, first of known systems, then of the six actuators",
    ),
    Story(
        name="time-varying",
        minutes=1.2,
        module="deatwin.scenarios.time_varying",
        line="tracks parameters that vary in time, and their frequency responses, first in known systems, then in the six actuators",
    ),
    Story(
        name="frequency-uncertainty",
        minutes=1.5,
        module="deatwin.scenarios.frequency_uncertainty",
        line="computes how uncertain frequency responses are, and where the six actuators differ",
    ),
    Story(
        name="regression-lessons",
        minutes=0.5,
        module="deatwin.scenarios.regression_lessons",
        line="demonstrates ridge and LASSO constraints, bias and variance, and Occam's razor, each with a check",
    ),
    Story(
        name="concealed-physics",
        minutes=240,
        module="deatwin.scenarios.concealed_physics",
        sizes=("tiny", "long", "standard", "full"),
        times=(5, 150, 240, 480),
        resumes=True,
        line="conceals effects in sealed cases and measures how often the diagnosis finds them",
    ),
    Story(
        name="unexplained-drift",
        minutes=5,
        module="deatwin.scenarios.unexplained_drift",
        resumes=True,
        line="conceals the drifts of six actuators and shows which ones the diagnosis names",
    ),
    Story(
        name="control-check",
        minutes=3,
        module="deatwin.scenarios.control_check",
        sizes=("short", "standard", "full"),
        times=(3, 15, 55),
        resumes=True,
        line="tests designs on rigs that are unknown to the check: the benefit of an inverse, and how often the verdict is right",
    ),
    Story(
        name="real-data",
        minutes=1,
        module="deatwin.scenarios.real_data",
        line="identifies models from public recordings and tests them in free run: Silverbox, buck converter, cascaded tanks, EMPS",
    ),
)
