// A plain editor: a text area with line numbers, and marks at lines with problems.

export class Editor {
  // edited: called with the text, a moment after the last key.
  constructor(root, edited) {
    root.innerHTML =
      '<pre class="lines" aria-hidden="true"></pre><textarea spellcheck="false" autocapitalize="off" autocomplete="off" wrap="off" aria-label="GLSL of the selected stage"></textarea>';
    [this.lines, this.area] = root.children;
    let timer = 0;
    this.area.addEventListener("input", () => {
      this.number();
      clearTimeout(timer);
      timer = setTimeout(() => edited(this.area.value), 250);
    });
    this.area.addEventListener("scroll", () => {
      this.lines.scrollTop = this.area.scrollTop;
    });
    this.area.addEventListener("keydown", (e) => {
      // Tab indents; Escape, then Tab leaves the editor
      if (e.key === "Escape") this.free = true;
      else if (e.key === "Tab" && !this.free && !e.shiftKey) {
        e.preventDefault();
        this.area.setRangeText("    ", this.area.selectionStart, this.area.selectionEnd, "end");
        this.area.dispatchEvent(new Event("input"));
      } else this.free = false;
    });
    this.wrong = new Map();
  }

  set(text, readonly) {
    this.area.value = text;
    this.area.readOnly = readonly;
    this.area.scrollTop = 0;
    this.mark([]);
  }

  // problems: [{line, text}] of the shown file.
  mark(problems) {
    this.wrong = new Map(problems.map((p) => [p.line, p.text]));
    this.number();
  }

  number() {
    this.lines.textContent = "";
    const count = this.area.value.split("\n").length;
    for (let n = 1; n <= count; n++) {
      const line = document.createElement("span");
      line.textContent = `${n}\n`;
      if (this.wrong.has(n)) {
        line.className = "wrong";
        line.title = this.wrong.get(n);
      }
      this.lines.append(line);
    }
    this.lines.scrollTop = this.area.scrollTop;
  }
}
