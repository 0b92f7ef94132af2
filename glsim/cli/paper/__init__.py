"""``glsim paper``: the commands that reproduce the paper."""

from __future__ import annotations

import typer

from glsim.cli.common import with_messages
from glsim.cli.paper import pages, reproduce, study, tables

app = typer.Typer(
    help="Reproduce the paper: its data, networks, tables and figures.", no_args_is_help=True
)
app.command("reproduce", epilog=reproduce.EXAMPLES)(with_messages(reproduce.reproduce))
app.command("tables", epilog=tables.EXAMPLES)(with_messages(tables.tables))
app.command("figures", epilog=pages.EXAMPLES)(with_messages(pages.figures))
app.command("page", epilog=pages.EXAMPLES)(with_messages(pages.page))
app.command("study", epilog=study.EXAMPLES)(with_messages(study.study))
