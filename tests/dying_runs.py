"""``generate`` in one process after the other, each of which kills itself at a given moment of the run.

    python dying_runs.py SCENE RUN [STAGE MOMENT]...

Moments of a stage: ``begins``; ``writes`` (its first file is written and has not got its name yet); ``unrecorded`` (all
its files are there, and nothing says so). The processes are forks of this one, so that the imports are paid for once.
"""

import os
import signal
import sys
from pathlib import Path

from phys4dgen import pipeline
from phys4dgen.cli import main
from phys4dgen.run import store
from phys4dgen.run.folder import RunFolder
from phys4dgen.run.recorder import RecordingProgress

assert pipeline
assert store


def die():
    os.kill(os.getpid(), signal.SIGKILL)


def kill_at(stage, moment):
    """Let this process die at a moment of a stage."""
    begin, name_file, finish = RecordingProgress.stage, Path.replace, RunFolder.finish
    running = []

    def begins(self, name):
        running.append(name)
        if (name, moment) == (stage, "begins"):
            die()
        begin(self, name)

    def writes(self, target):
        if running[-1:] == [stage] and moment == "writes":
            die()
        return name_file(self, target)

    def unrecorded(self, entry, record):
        if (entry.name, moment) == (stage, "unrecorded"):
            die()
        finish(self, entry, record)

    RecordingProgress.stage, Path.replace, RunFolder.finish = begins, writes, unrecorded


def run_until_killed(words, stage, moment):
    child = os.fork()
    if child == 0:
        kill_at(stage, moment)
        os._exit(main(words))
    _, status = os.waitpid(child, 0)
    if not os.WIFSIGNALED(status):
        sys.exit(f"it should have died when {stage} {moment}, and ended with {os.waitstatus_to_exitcode(status)}")


if __name__ == "__main__":
    scene, run, *moments = sys.argv[1:]
    for place in range(0, len(moments), 2):
        run_until_killed(["generate", "--scene", scene, "-o", run, "-q"], *moments[place : place + 2])
