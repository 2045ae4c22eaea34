"""Shell completion."""

import click
from click.shell_completion import get_completion_class

_PLACES = {
    "bash": "wearscope completion bash > ~/.local/share/bash-completion/completions/wearscope",
    "zsh": "wearscope completion zsh > ~/.zfunc/_wearscope",
    "fish": "wearscope completion fish > ~/.config/fish/completions/wearscope.fish",
}


@click.command(epilog="\b\n" + "\n".join(["Examples:", *(f"  {line}" for line in _PLACES.values())]))
@click.argument("shell", type=click.Choice(list(_PLACES)))
def completion(shell: str) -> None:
    """Write what completes the command in SHELL."""
    from wearscope.cli.main import wearscope

    kind = get_completion_class(shell)
    assert kind is not None
    click.echo(kind(wearscope, {}, "wearscope", "_WEARSCOPE_COMPLETE").source())
