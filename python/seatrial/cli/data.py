"""`seatrial data`: recordings of real vehicles from their original source, checked by their hash."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Literal

import typer

from seatrial.cli.options import Json

if TYPE_CHECKING:
    from seatrial.base.data_sets import DataFile


def data(
    action: Annotated[
        Literal["get", "list"],
        typer.Argument(help="Fetch data sets, or list what there is.", metavar="get|list"),
    ],
    names: Annotated[
        list[str] | None, typer.Argument(help="Data sets: beluga, t200, bluerov2.", metavar="NAME")
    ] = None,
    source: Annotated[
        str | None,
        typer.Option(
            "--from", metavar="URL", help="Mirror with a folder per data set, instead of the original source."
        ),
    ] = None,
    json: Json = False,
) -> None:
    """Fetch recordings of real vehicles (beluga, t200, bluerov2) into SEATRIAL_DATA or the user's cache.

    A file counts only with its SHA-256; one that is there is not fetched again.

    Example: seatrial data get beluga
    """
    from seatrial.base.data_sets import DATA_SETS, data_folder, get
    from seatrial.base.errors import TrialError
    from seatrial.base.report import Report, Section, Table
    from seatrial.cli.console import answer, print_json, say

    if action == "get" and not names:
        raise TrialError(
            f"data get: expected the name of a data set, found none; one of {', '.join(DATA_SETS)}"
        )
    folder = data_folder()
    if action == "list":
        chosen = names or list(DATA_SETS)
        missing = [name for name in chosen if name not in DATA_SETS]
        if missing:
            get(missing[0])
        rows = [
            (
                name,
                f"{sum((folder / one.folder / f.name).is_file() for f in one.files)} of {len(one.files)}",
                f"{sum(f.size for f in one.files) / 1e6:.1f}",
                one.description,
                one.licence,
            )
            for name, one in DATA_SETS.items()
            if name in chosen
        ]
        if json:
            keys = ("name", "files", "megabytes", "description", "licence")
            print_json({"folder": str(folder), "sets": [dict(zip(keys, row, strict=True)) for row in rows]})
            return
        table = Table.of("", ("name", "files here", "MB", "what", "licence"), rows)
        answer(
            Report(
                title=str(folder),
                outcome=f"{len(rows)} data sets",
                good="the folder of recordings",
                worst="nothing is checked before it is fetched or used",
                next_step="fetch one with seatrial data get NAME",
                sections=(Section(tables=(table,)),),
            )
        )
        return

    def begin(one: DataFile) -> None:
        if not json:
            say(f"fetching {one.name} ({one.size / 1e6:.1f} MB)")

    found = {name: get(name, source=source, begin=begin) for name in names or ()}
    if json:
        print_json({
            "folder": str(folder),
            "sets": {name: {str(path): new for path, new in files.items()} for name, files in found.items()},
        })
        return
    fetched = sum(sum(files.values()) for files in found.values())
    count = sum(map(len, found.values()))
    answer(
        Report(
            title=", ".join(found),
            outcome="here",
            good=f"{count} files in {folder} with the right SHA-256, {fetched} of them fetched",
            worst="none: every file is the published one",
            next_step=f"set SEATRIAL_DATA={folder} for campaigns and tests that name it",
            sections=(
                Section(
                    sentences=tuple(
                        f"{name}: {DATA_SETS[name].description}; {DATA_SETS[name].licence}" for name in found
                    )
                ),
            ),
        )
    )
