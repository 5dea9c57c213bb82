"""Ctrl-C during an estimate: the best so far, from real signals."""

import os
import signal
import subprocess
import sys
import textwrap

import pytest

SLOW = """
    import os, signal, sys, threading, time
    import numpy as np
    import orbid

    class Slow(orbid.Residual):
        # Rosenbrock's valley from afar takes tens of steps: there is time to press a key.
        def groups(self):
            return [{"name": "e", "sd": 1.0}]

        def layout(self):
            return [{"records": 2}]

        def evaluate(self, theta, latents, derivatives):
            on_evaluation()
            x, y = theta
            return {"e": np.array([100 * (y - x * x), 1 - x]),
                    "e_theta": np.array([[-200 * x, 100.0], [-1.0, 0.0]])}

    calls = 0
    start = {"x": -1.2, "y": 1.0}
"""


def run(text):
    return subprocess.run(
        [sys.executable, "-c", textwrap.dedent(SLOW) + textwrap.dedent(text)],
        capture_output=True,
        text=True,
        timeout=120,
        env=os.environ,
    )


@pytest.mark.skipif(sys.platform == "win32", reason="signals")
def test_interrupt_returns_the_best_so_far():
    done = run(
        """
        def on_evaluation():
            global calls
            calls += 1
            if calls == 5:
                os.kill(os.getpid(), signal.SIGINT)
            if calls >= 5:
                time.sleep(0.1)

        result = orbid.estimate(start, Slow())
        x, y = result.theta
        print(result.status, result.iterations, 100 * (y - x * x) ** 2 + (1 - x) ** 2 < 24.2)
        print(result.message)
        """
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("interrupted "), done.stdout
    assert "True" in done.stdout and "interrupted after" in done.stdout


def test_interrupt_from_outside():
    process = subprocess.Popen(
        [
            sys.executable,
            "-c",
            textwrap.dedent(SLOW)
            + textwrap.dedent(
                """
                def on_evaluation():
                    global calls
                    calls += 1
                    if calls == 3:
                        print("ready", flush=True)
                    time.sleep(0.1 if calls >= 3 else 0.0)

                print(orbid.estimate(start, Slow()).status, calls)
                """
            ),
        ],
        stdout=subprocess.PIPE,
        text=True,
    )
    assert process.stdout.readline() == "ready\n"
    process.send_signal(signal.SIGINT)
    answer, _ = process.communicate(timeout=120)
    assert process.returncode == 0
    assert answer.startswith("interrupted ")
    assert int(answer.split()[1]) < 20


def test_second_interrupt_raises():
    done = run(
        """
        def on_evaluation():
            global calls
            calls += 1
            if calls == 4:
                for _ in range(2):
                    os.kill(os.getpid(), signal.SIGINT)
                    time.sleep(0.3)

        try:
            orbid.estimate(start, Slow())
        except KeyboardInterrupt:
            print("raised")
        """
    )
    assert done.stdout == "raised\n", done.stderr


def test_interrupt_raised_by_a_thread_and_handlers_of_ones_own():
    done = run(
        """
        def on_evaluation():
            global calls
            calls += 1
            if calls == 4:
                other = threading.Thread(target=signal.raise_signal, args=(signal.SIGINT,))
                other.start()
                other.join()
            if calls >= 4:
                time.sleep(0.1)

        print(orbid.estimate(start, Slow()).status)
        calls = 0

        def handler(number, frame):
            raise RuntimeError("a handler of its own")

        signal.signal(signal.SIGINT, handler)
        try:
            orbid.estimate(start, Slow())
        except RuntimeError as error:
            print(error)
        """
    )
    assert done.stdout == "interrupted\na handler of its own\n", done.stderr
