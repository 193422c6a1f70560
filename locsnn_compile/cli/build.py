"""What ``locsnn compile`` does: read the model, compile and check it, and write the build."""

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
from locsnn_compile.cli.options import given, recording_of
from locsnn_compile.cli.places import check_places
from locsnn_compile.cli.shell import EXIT_GATE, progress_bar, terminal
from locsnn_compile.cli.step_options import (
    FILE_OPTIONS,
    asked_reading,
    file_reading,
    on_sensor,
    undivided_reading,
    with_steps,
)
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
BOUNDS = ("--min-agreement", "--max-spike-error", "--max-score-error")


def build(args: Namespace) -> int:
    """Compile as ``args`` ask. Raises ``InputError`` and ``TargetError``."""
    _check_options(args)

    name = "+".join(Path(model).stem for model in args.model)
    folder = Path(args.output) if args.output else default_folder(f"{name}.pt")
    _check_places(args, folder)
    network = asked_network(args)
    target = chip_named(args.target)
    family = family_of(target)
    family.check_network(target, network)
    family.check_kinds(target, args.emit)
    recordings, calibration = asked_recordings(args, network)
    number = recording_of(args.recording, recordings)
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
    gates = check_gates(compiled.figures, given(args, GATES))
    compiled = compiled.with_gates(gates_entry(gates))
    title = f"recording {number} of {recordings.source}"
    shown = ShownRecording(recordings.spikes[number], title, args.probe)
    files = compiled.files(args.emit, shown)
    earlier = _of_an_earlier_build(folder, files)
    write_build(folder, files, NAMES_IN_FOLDERS)
    if args.junit:
        replace_file(Path(args.junit), junit_file(gates, compiled.network.name), where="--junit")
    if args.json:
        sys.stdout.write(files["report.json"].decode())
    elif not args.quiet:
        from locsnn_compile.report.renderers.terminal import render_terminal

        console = terminal()
        render_terminal(compiled.composed, console)
        names = dict.fromkeys(f"{name.split('/')[0]}/" if "/" in name else name for name in files)
        console.print(
            f"wrote {folder}/: {', '.join(names)}", markup=False, highlight=False, soft_wrap=True
        )
    if earlier:
        print(
            f"-o {str(folder)!r}: an earlier build left {listed(earlier)} there. "
            "Emit them again, or remove them.",
            file=sys.stderr,
        )
    if args.calibration is not None and _rounds_one_by_one(args):
        print(
            "--calibration: it changed nothing: strategy reset rounds each weight by itself.",
            file=sys.stderr,
        )
    failed = [gate for gate in gates if not gate.holds]
    for gate in failed:
        print(f"gate failed: {gate.option}: {gate.found}.", file=sys.stderr)
    unmet = compiled.choice is not None and not compiled.choice.keeps_budget
    if compiled.choice and unmet:
        print(unmet_budget(compiled.choice), file=sys.stderr)
    return EXIT_GATE if failed or unmet else 0


def _rounds_one_by_one(args: Namespace) -> bool:
    """Tell whether nothing is rounded or chosen for recordings; a committee's weights of scores are found on some."""
    return args.strategy == "reset" and not given(args, BOUNDS) and len(args.model) == 1


def _setting_request(
    args: Namespace, target: AnyChip, network: Network, calibration: Recordings | None
) -> SettingRequest:
    """Return what the options ask of the setting."""
    values = picked(args, *(dial.name for dial in DIALS))
    setting = setting_of(target, network, values)
    budget = None
    # Where there is one setting, bounds are gates of the report alone.
    if family_of(target).bounds_choose:
        budget = ErrorBudget(args.min_agreement, args.max_spike_error, args.max_score_error)
    request = SettingRequest.of(setting, values, budget, calibration)
    if args.spike_worth is None:
        return request
    weighs = request.setting.strategy == AUTO and network.by_strategy
    if request.budget.given or not weighs:
        what = "it weighs what --strategy auto chooses without bounds, which is not done here"
        raise InputError("--spike-worth", what, fix="Leave it out.")
    return replace(request, spike_worth=args.spike_worth)


def _of_an_earlier_build(folder: Path, files: Mapping[str, bytes]) -> list[str]:
    """Return what another build emitted there and this one does not: it stays, as it could be the user's by now."""
    there = [folder / name for name in BUILD_NAMES if (folder / name).is_file()]
    if all(path.read_bytes() == files[path.name] for path in there):
        return []
    written = {name.split("/")[0] for name in files}
    return [
        name
        for name in (emitter.path for emitter in EMITTERS)
        if name.strip("/") not in written and (folder / name).exists()
    ]


def asked_network(args: Namespace) -> Network:
    """Read the model, or join several, in the steps asked for; refuse options that change nothing for it."""
    options = LoadOptions.of(args)
    networks = [load(model, **vars(options)) for model in args.model]
    if args.weights and len(networks) < 2:
        if networks[0].members:
            fix = "Leave it out, or pack the models again: locsnn pack --weights."
            raise InputError("--weights", "the file of this committee holds its weights", fix=fix)
        raise InputError(
            "--weights", "there is one model, with nothing to weigh it against", fix="Leave it out."
        )
    reading = undivided_reading(args)
    network = networks[0]
    if len(networks) > 1:
        network = join(networks, args.weights, args.calibration, reading)
    network = on_sensor(network, args)
    dials = [dial.option for dial in DIALS if dial.idle]
    asked = given(args, (*dials, "--calibration", "--psi"))
    if network.has_float_weights and given(args, BOUNDS):  # settings are chosen on --calibration
        asked.pop("--calibration", None)
    check_matters(network, {option.strip("-").replace("-", "_"): option for option in asked})
    return with_steps(network, args)


def asked_recordings(args: Namespace, network: Network) -> tuple[Recordings, Recordings | None]:
    """Return the recordings to check on, and those to calibrate on; never the same of a file that is divided here."""
    divided = given(args, ("--split", "--fold"))
    if args.events is None:
        used = args.calibration is not None or args.channel_order is not None
        for option in (*divided, *(() if used else given(args, FILE_OPTIONS))):
            raise InputError(option, "there are no events to read", fix="Give them with --events.")
        return recordings_for(network, None), _calibration(args, network)
    if network.host is not None:
        return _values_through_host(args, network), _calibration(args, network)
    reading = {"model": network.expected, **asked_reading(args)}
    recordings = read_recordings(args.events, **reading)
    if divided and args.calibration == args.events:
        return recordings, read_recordings(args.events, split="train", **reading)
    return recordings, _calibration(args, network)


def _values_through_host(args: Namespace, network: Network) -> Recordings:
    """Return what the host sends for the numbers of --events; refuse options that describe events."""
    for option in given(args, (*FILE_OPTIONS, "--split", "--fold", "--threshold")):
        what = "it describes recordings of events, and layers on the host take arrays of numbers"
        raise InputError(option, what, fix="Leave it out.")
    return recordings_for(network, args.events)


def _calibration(args: Namespace, network: Network) -> Recordings | None:
    """Return the recordings of --calibration, of the sensor that the options describe."""
    if args.calibration is None:
        return None
    return calibration_recordings(network, args.calibration, file_reading(args))


def _check_options(args: Namespace) -> None:
    """Refuse options that would fail only after all the work."""
    if args.recording is not None:
        check_recording_is_shown(args.emit)
    if args.probe and "vcd" not in args.emit:
        raise InputError("--probe", "no emitted file shows a neuron", fix="Add --emit vcd.")
    if args.junit and not given(args, GATES):
        raise InputError("--junit", "no gate is asked for", fix=f"Add one of {', '.join(GATES)}.")


def _check_places(args: Namespace, folder: Path) -> None:
    """Refuse outputs that are inputs, or that would replace files of others."""
    names = written_names(args.emit)
    check_folder(folder, names, NAMES_IN_FOLDERS)
    reads = {
        f"MODEL {model!r}" if args.model[1:] else "MODEL": model for model in args.model
    } | given(args, READ)
    junit = [(f"--junit {args.junit!r}", Path(args.junit))] if args.junit else []
    check_places(reads, junit, [(f"-o {str(folder)!r}", folder / name) for name in names])


def written_names(emit: Sequence[str]) -> tuple[str, ...]:
    """Return the names of what a build's folder holds; names of folders end in /."""
    return (*BUILD_NAMES, *(emitter.path for emitter in emitters_of(emit)))
