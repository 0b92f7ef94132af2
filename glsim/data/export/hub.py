"""Push a data set to the Hugging Face Hub, as a repository of its files."""

from __future__ import annotations

from pathlib import Path

from glsim.core.errors import ConfigError, DatasetError, require_package
from glsim.data.cards import write_cards
from glsim.data.disk_format import README, STATE
from glsim.data.header import read_header


def push_dataset(place: Path | str, repository: str, *, public: bool = False) -> str:
    """Push a complete data set to a repository of the Hub, which is made if there is none.

    The files go as they are, with cards (``write_cards``) unless README.md is there: the Hub reads
    it and shows the splits. A second push sends what has changed. The token is that of ``hf auth
    login``, or HF_TOKEN; HF_ENDPOINT names another server than the Hub.

    Args:
        place: folder of the data set.
        repository: "owner/name".
        public: whether a new repository can be seen by everybody.

    Returns:
        The address of the repository.

    Raises:
        ConfigError: without huggingface_hub or a token, or for a wrong name.
        DatasetError: the data set is not complete, or the Hub refuses or cannot be reached.
    """
    place = Path(place)
    read_header(place)
    require_package("huggingface_hub", f"--hf {repository}", "hub")
    import huggingface_hub as hub
    from huggingface_hub.errors import HFValidationError

    token = hub.get_token()
    if token is None:
        raise ConfigError(f"--hf {repository}: no token: run hf auth login, or set HF_TOKEN")
    if repository.count("/") != 1:
        raise ConfigError(f"--hf {repository}: give owner/name")
    if not (place / README).is_file():
        write_cards(place)
    api = hub.HfApi(token=token, library_name="glsim")
    try:
        url = api.create_repo(repository, repo_type="dataset", private=not public, exist_ok=True)
        api.upload_folder(
            repo_id=repository,
            folder_path=place,
            repo_type="dataset",
            commit_message="Data set of glsim",
            ignore_patterns=[f"{STATE}/**"],
        )
    except HFValidationError as error:
        raise ConfigError(f"--hf {repository}: {_first_line(error)}") from None
    except Exception as error:  # of its HTTP library, which is another one from version to version
        raise DatasetError(f"--hf {repository}: was not pushed: {_first_line(error)}") from None
    return str(url)


def _first_line(error: Exception) -> str:
    return " ".join(str(error).split())[:300] or type(error).__name__
