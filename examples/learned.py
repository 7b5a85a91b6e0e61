"""The same push under the planner and under a trained policy that comes with the package."""

from push_recovery.eval.record.words import push_words, verdict

from push_recovery import GaitEvent, Push, Scenario, record

push = Push(force=(0.0, 1200.0, 0.0), duration=0.1, start=GaitEvent(step=4, side="left"))
for policy in ("two-stage", "joint-residual"):  # docs/policies.md has the other names
    episode = record(policy, Scenario("left shove", (push,)))
    lean = abs(episode["trunk_roll"]).max()
    print(f"{policy}: {push_words(episode)}: {verdict(episode.outcome)}; trunk leant {lean:.2f} rad at most")
