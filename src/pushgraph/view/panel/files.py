"""Files of the folder that the page was started for."""

import html

from pushgraph.view.panel.controls import NONE, Controls, offer
from pushgraph.view.session import block
from pushgraph.view.workbench import SAVED


class FileControls(Controls):
    """Load what pushgraph writes, and save what there is."""

    def make(self) -> None:
        """Add the controls where the GUI stands."""
        self.gui.add_html(block(f"Folder: {html.escape(str(self.workbench.folder.path))}"))
        self.file = self.gui.add_dropdown("File", (NONE,))
        self.buttons("from here", {"Load": self._load, "Look again": lambda: None}, "Load it; look for new files")
        self.gui.add_divider()
        self.what = self.gui.add_dropdown("Save", tuple(SAVED))
        self.name = self.gui.add_text("as", "")
        self.replace = self.gui.add_checkbox("replace", False, hint="Even if there is such a file already")
        self.buttons("to here", {"Save": self._save})

    def refresh(self) -> None:
        """List the files there are."""
        offer(self.file, self.workbench.folder.files())

    def _load(self) -> str:
        self.workbench.load(self.file.value)
        return f"Loaded {self.file.value}."

    def _save(self) -> str:
        path = self.workbench.save(self.what.value, self.name.value or self.what.value, self.replace.value)
        return f"Saved {path.relative_to(self.workbench.folder.path)}."
