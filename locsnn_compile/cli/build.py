"""What ``locsnn compile`` does: read the model, compile and check it, and write the build.

A build is the folder that holds the program for the chip, the report of its check against the
trained network, and whatever ``--emit`` adds. ``compile.py`` declares the command and imports this
module only when it compiles, because everything that a compilation needs is imported here.
"""

import sys
from argparse import Namespace
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from hw_model.io.build_folder import check_folder, default_folder, write_build
from hw_model.io.files import replace_file
from hw_model.targets.families import AnyChip, chip_named
from hw_model.values import picked
from locsnn_compile.api import fulfil, join
from locsnn_compile.cli.options import given_options, recording_number
from locsnn_compile.cli.places import check_places
from locsnn_compile.cli.shell import EXIT_GATE, progress_bar, terminal
from locsnn_compile.cli.step_options import (
    FILE_OPTIONS,
    file_reading_options,
    on_sensor,
    reading_options,
    undivided_reading_options,
    with_steps,
)
from locsnn_compile.compiled import Compiled
from locsnn_compile.data.read import read_recordings
from locsnn_compile.data.recordings import Recordings
from locsnn_compile.emitters import (
    BUILD_NAMES,
    EMITTERS,
    NAMES_IN_FOLDERS,
    ShownRecording,
    check_recording_is_shown,
    emitters_of,
)
from locsnn_compile.errors import InputError, listed
from locsnn_compile.families import family_of, setting_of
from locsnn_compile.frontends import load
from locsnn_compile.frontends.format_rows import LoadOptions
from locsnn_compile.network.network import Network
from locsnn_compile.report.gates import GATES, check_gates, gates_entry, junit_file
from locsnn_compile.report.sections.build import unmet_budget
from locsnn_compile.request.compile_request import (
    CheckRequest,
    CompileRequest,
    PricingRequest,
    SettingRequest,
)
from locsnn_compile.request.recordings import calibration_recordings, recordings_for
from locsnn_compile.settings import AUTO, DIALS, check_matters
from locsnn_compile.verification.error_bounds import ErrorBudget

READ = ("--options", "--config", "--events", "--calibration", "--target", "--profile")
"""Options that name files to read, which no output may replace."""
BOUNDS = ("--min-agreement", "--max-spike-error", "--max-score-error")
"""Options that bound what the chip may lose: the compiler chooses a setting that keeps them."""


def build(args: Namespace) -> int:
    """Compile as ``args`` ask. Raises ``InputError`` and ``TargetError``."""
    _check_options(args)
    name = "+".join(Path(model).stem for model in args.model)
    # default_folder takes a file name and drops its ending: a dot in the name must not be taken for
    # the ending, so it gets one.
    folder = Path(args.output) if args.output else default_folder(f"{name}.pt")
    _check_places(args, folder)
    network = read_network(args)
    target = chip_named(args.target)
    family = family_of(target)
    # Before any recording is read, which may take minutes.
    family.check_network(target, network)
    family.check_kinds(target, args.emit)
    recordings, calibration = check_and_calibration_recordings(args, network)
    number = recording_number(args.recording, recordings)
    with progress_bar("checking against the trained network", show=not args.quiet) as progress:
        check = CheckRequest(
            recordings,
            psi=args.psi,
            scheduler=args.scheduler,
            progress=progress,
            events_per_step=args.events_per_step,
        )
        setting_request = _setting_request(args, target, network, calibration)
        pricing = PricingRequest(args.profile)
        compiled = fulfil(CompileRequest(network, target, setting_request, check, pricing))
    gates = check_gates(compiled.figures, given_options(args, GATES))
    compiled = compiled.with_gates(gates_entry(gates))
    title = f"recording {number} of {recordings.source}"
    shown = ShownRecording(recordings.spikes[number], title, args.probe)
    files = compiled.files(args.emit, shown)
    # Looked for before writing: afterwards the folder holds this build.
    leftovers = _left_by_earlier_build(folder, files)
    write_build(folder, files, NAMES_IN_FOLDERS)
    if args.junit:
        replace_file(Path(args.junit), junit_file(gates, compiled.network.name), where="--junit")
    if args.json:
        sys.stdout.write(files["report.json"].decode())
    elif not args.quiet:
        _print_summary(compiled, folder, files)
    if leftovers:
        _warn(
            f"-o {str(folder)!r}: an earlier build left {listed(leftovers)} there. "
            "Emit them again, or remove them."
        )
    if args.calibration is not None and _needs_no_calibration(args):
        _warn("--calibration: it changed nothing: strategy reset rounds each weight by itself.")
    failed_gates = [gate for gate in gates if not gate.holds]
    for gate in failed_gates:
        _warn(f"gate failed: {gate.option}: {gate.found}.")
    is_over_budget = False
    if compiled.choice is not None and not compiled.choice.keeps_budget:
        is_over_budget = True
        _warn(unmet_budget(compiled.choice))
    return EXIT_GATE if failed_gates or is_over_budget else 0


def _warn(line: str) -> None:
    """Print a line to standard error: standard output may be report.json, and nothing else."""
    print(line, file=sys.stderr)


def _print_summary(compiled: Compiled, folder: Path, files: Mapping[str, bytes]) -> None:
    """Print the summary of the report, and the names of the files and folders that were written."""
    from locsnn_compile.report.renderers.terminal import render_terminal

    console = terminal()
    render_terminal(compiled.composed, console)
    names: dict[str, None] = {}  # in the order of the files; the files of a folder share one name
    for name in files:
        first, slash, _ = name.partition("/")
        names[first + slash] = None
    # A path is printed as it is: rich would read brackets as markup, colour numbers and break lines.
    console.print(
        f"wrote {folder}/: {', '.join(names)}", markup=False, highlight=False, soft_wrap=True
    )


def _needs_no_calibration(args: Namespace) -> bool:
    """Return whether recordings for calibration change nothing, so that giving them is noted.

    Strategy ``reset`` rounds each weight to the nearest. Bounds would choose a setting on these
    recordings, and several models would get their weights in the sum of class scores from them.
    """
    is_single_model = len(args.model) == 1
    return args.strategy == "reset" and not given_options(args, BOUNDS) and is_single_model


def _setting_request(
    args: Namespace, target: AnyChip, network: Network, calibration: Recordings | None
) -> SettingRequest:
    """Return the setting that the options ask for, and what it is chosen by if it is left open.

    A setting has a value for each dial: strategy, weight bits and split weights (``settings.py``).
    """
    values = picked(args, *(dial.name for dial in DIALS))
    setting = setting_of(target, network, values)
    budget = None
    # A family of chips with a single setting has nothing to choose: there, bounds are only gates of
    # the report.
    if family_of(target).bounds_choose:
        budget = ErrorBudget(args.min_agreement, args.max_spike_error, args.max_score_error)
    request = SettingRequest.of(setting, values, budget, calibration)
    if args.spike_worth is None:
        return request
    is_weighed = request.setting.strategy == AUTO and network.by_strategy
    if request.budget.given or not is_weighed:
        what = "it weighs what --strategy auto chooses without bounds, which is not done here"
        raise InputError("--spike-worth", what, fix="Leave it out.")
    return replace(request, spike_worth=args.spike_worth)


def _left_by_earlier_build(folder: Path, files: Mapping[str, bytes]) -> list[str]:
    """Return the names of what another build emitted into the folder and this build does not replace.

    These files stay, because they may be the user's by now, but they do not belong to this program.
    If the program and its reports there equal those of this build, it was the same build, and what
    it emitted belongs to this one too.
    """
    earlier_files = [folder / name for name in BUILD_NAMES if (folder / name).is_file()]
    if all(path.read_bytes() == files[path.name] for path in earlier_files):
        return []
    written = {name.split("/")[0] for name in files}
    leftovers = []
    for emitter in EMITTERS:
        is_written = emitter.path.strip("/") in written
        if not is_written and (folder / emitter.path).exists():
            leftovers.append(emitter.path)
    return leftovers


def read_network(args: Namespace) -> Network:
    """Return the network of the model, or several models joined into one, in the steps asked for.

    Raises ``InputError`` for options that would change nothing for this network.
    """
    options = LoadOptions.of(args)
    networks = [load(model, **vars(options)) for model in args.model]
    if args.weights and len(networks) < 2:
        if networks[0].members:
            fix = "Leave it out, or pack the models again: locsnn pack --weights."
            raise InputError("--weights", "the file of this committee holds its weights", fix=fix)
        raise InputError(
            "--weights", "there is one model, with nothing to weigh it against", fix="Leave it out."
        )
    reading = undivided_reading_options(args)
    network = networks[0]
    if len(networks) > 1:
        network = join(networks, args.weights, args.calibration, reading)
    network = on_sensor(network, args)
    # Dials without ``idle`` are left out: whether such a dial changes anything is found out later.
    dial_options = [dial.option for dial in DIALS if dial.idle]
    options_that_may_be_idle = given_options(args, (*dial_options, "--calibration", "--psi"))
    if network.has_float_weights and given_options(args, BOUNDS):
        # The bounds choose a setting on these recordings, even if no weight is rounded for them.
        options_that_may_be_idle.pop("--calibration", None)
    by_name = {option.strip("-").replace("-", "_"): option for option in options_that_may_be_idle}
    check_matters(network, by_name)
    return with_steps(network, args)


def check_and_calibration_recordings(
    args: Namespace, network: Network
) -> tuple[Recordings, Recordings | None]:
    """Return the recordings to check on, and those to calibrate on, which are None if not given.

    Of a file that ``--split`` or ``--fold`` divides, the check gets the test part and calibration
    the train part, so that no recording is in both.
    """
    division_options = given_options(args, ("--split", "--fold"))
    if args.events is None:
        _refuse_reading_options(args, division_options)
        return recordings_for(network, events=None), _calibration(args, network)
    if network.host is not None:
        return _values_through_host(args, network), _calibration(args, network)
    reading = {"model": network.expected, **reading_options(args)}
    recordings = read_recordings(args.events, **reading)
    if division_options and args.calibration == args.events:
        return recordings, read_recordings(args.events, split="train", **reading)
    return recordings, _calibration(args, network)


def _refuse_reading_options(args: Namespace, division_options: Mapping[str, object]) -> None:
    """Refuse options on how events are read or divided, where there are no events."""
    useless = list(division_options)
    # They also describe the recordings of --calibration, and the inputs that --channel-order numbers.
    if args.calibration is None and args.channel_order is None:
        useless += given_options(args, FILE_OPTIONS)
    if useless:
        raise InputError(useless[0], "there are no events to read", fix="Give them with --events.")


def _values_through_host(args: Namespace, network: Network) -> Recordings:
    """Return the spikes that the host sends for the numbers of ``--events``.

    The first layers of some networks run on the host computer and take numbers instead of spikes.
    Raises ``InputError`` for options that describe events, because numbers have none.
    """
    for option in given_options(args, (*FILE_OPTIONS, "--split", "--fold", "--threshold")):
        what = "it describes recordings of events, and layers on the host take arrays of numbers"
        raise InputError(option, what, fix="Leave it out.")
    return recordings_for(network, args.events)


def _calibration(args: Namespace, network: Network) -> Recordings | None:
    """Return the recordings of ``--calibration``, read as from the sensor that the options describe."""
    if args.calibration is None:
        return None
    return calibration_recordings(network, args.calibration, file_reading_options(args))


def _check_options(args: Namespace) -> None:
    """Refuse options that would fail only after all the work."""
    if args.recording is not None:
        check_recording_is_shown(args.emit)
    if args.probe and "vcd" not in args.emit:
        raise InputError("--probe", "no emitted file shows a neuron", fix="Add --emit vcd.")
    if args.junit and not given_options(args, GATES):
        raise InputError("--junit", "no gate is asked for", fix=f"Add one of {', '.join(GATES)}.")


def _check_places(args: Namespace, folder: Path) -> None:
    """Refuse outputs that are inputs, or that would replace files that no build wrote."""
    names = written_names(args.emit)
    check_folder(folder, names, NAMES_IN_FOLDERS)
    inputs: dict[str, str] = {}
    for model in args.model:
        option = "MODEL" if len(args.model) == 1 else f"MODEL {model!r}"
        inputs[option] = model
    inputs |= given_options(args, READ)
    files = []
    if args.junit:
        files.append((f"--junit {args.junit!r}", Path(args.junit)))
    entries = [(f"-o {str(folder)!r}", folder / name) for name in names]
    check_places(inputs, files, entries)


def written_names(emit: Sequence[str]) -> tuple[str, ...]:
    """Return the names of what a build's folder holds; names of folders end in /."""
    return (*BUILD_NAMES, *(emitter.path for emitter in emitters_of(emit)))
