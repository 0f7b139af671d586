"""`motiongen list`: the generators, models, file formats and constraints there are."""

from __future__ import annotations

import json
from collections.abc import Sequence

from motiongen import io
from motiongen.assets import BUNDLED_MODEL
from motiongen.commands.arguments import Parser
from motiongen.generators.constraints import CONSTRAINTS
from motiongen.generators.registry import specs


def run(arguments: Sequence[str]) -> None:
    """Print what there is; imports no generator."""
    parser = Parser(
        prog="motiongen list", description="The generators, models, file formats and constraints there are."
    )
    parser.add_argument("--json", action="store_true", help="print JSON")
    options = parser.parse_args(arguments)
    known = specs()
    constraints = {kind.__name__: (kind.__doc__ or "").splitlines()[0] for kind in CONSTRAINTS}
    model = _bundled_model()
    if options.json:
        generators = [
            {"name": name, "description": spec.description, "error": spec.error} for name, spec in known.items()
        ]
        print(
            json.dumps(
                {
                    "generators": generators,
                    "models": {"modi": model},
                    "formats": io.formats(),
                    "constraints": constraints,
                },
                indent=2,
            )
        )
        return
    print("generators")
    for name, spec in known.items():
        print(f"  {name:<12}  {spec.description if spec.error is None else 'BROKEN: ' + spec.error}")
    if model:
        print(f"\nmodels\n  {'modi':<12}  {model}")
    print("\nformats")
    print(f"  {', '.join(io.formats())}")
    print("\nconstraints")
    for name, text in constraints.items():
        print(f"  {name:<12}  {text}")


def _bundled_model() -> str:
    """One line on the checkpoint that comes along; empty where none does."""
    place = BUNDLED_MODEL / "model.json"
    if not place.is_file():
        return ""
    card = json.loads(place.read_text(encoding="utf-8"))
    what = f"{len(card['layout']['names'])} joints, {card['network']['frames']} frames at {card['frame_rate_hz']:g} Hz"
    return f"{what}, {card['iteration']:,} iterations. {card['credit']}"
