// Dark or light: as the system wishes, until the button is pressed. themed: called after each change.
export function followTheme(button, themed) {
  const set = (dark) => {
    document.body.classList.toggle("body--dark", dark);
    button.setAttribute("aria-pressed", String(dark));
    themed();
  };
  const wish = matchMedia("(prefers-color-scheme: dark)");
  button.addEventListener("click", () => set(!document.body.classList.contains("body--dark")));
  wish.addEventListener("change", () => set(wish.matches));
  set(wish.matches);
}
