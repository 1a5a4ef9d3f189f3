"use strict";
const viewers = [...document.querySelectorAll(".viewer")];
function show(viewer, kind, isLasting) {
  const images = [...viewer.querySelectorAll(".stack img")];
  const image = images.find((one) => one.dataset.kind === kind);
  if (!image) return;
  for (const one of images) one.hidden = one !== image;
  for (const button of viewer.querySelectorAll("button")) button.setAttribute("aria-pressed", button.dataset.kind === kind);
  viewer.querySelector(".scale").textContent = image.dataset.title;
  if (isLasting) viewer.dataset.kind = kind;
}
for (const viewer of viewers) {
  viewer.dataset.kind = "0";
  const stack = viewer.querySelector(".stack");
  stack.addEventListener("mouseenter", () => show(viewer, viewer.dataset.kind === "0" ? "1" : "0", false));
  stack.addEventListener("mouseleave", () => show(viewer, viewer.dataset.kind, false));
  for (const button of viewer.querySelectorAll("button")) {
    const thumbnail = viewer.querySelector(`.stack img[data-kind="${button.dataset.kind}"]`).cloneNode();
    thumbnail.hidden = false;
    thumbnail.alt = "";
    button.prepend(thumbnail);
    button.addEventListener("click", () => show(viewer, button.dataset.kind, true));
  }
}
document.addEventListener("keydown", (event) => {
  if (event.target.type === "search" || event.ctrlKey || event.metaKey || event.altKey) return;
  if (event.key >= "1" && event.key <= "4") for (const viewer of viewers) show(viewer, String(event.key - 1), true);
});
const failures = document.getElementById("failures");
const name = document.getElementById("name");
function filter() {
  let left = 0;
  for (const one of document.querySelectorAll(".case")) {
    const fits = one.dataset.name.toLowerCase().includes(name.value.toLowerCase());
    one.hidden = !fits || (failures.checked && one.classList.contains("pass"));
    left += one.hidden ? 0 : 1;
  }
  document.getElementById("none").hidden = left > 0;
}
failures.addEventListener("change", filter);
name.addEventListener("input", filter);
document.getElementById("filter").addEventListener("submit", (event) => event.preventDefault());
filter();
