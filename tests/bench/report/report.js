// SPDX-License-Identifier: Apache-2.0
// The image viewer: two images of a case on top of one another, wiped by pointer, slider or keys.
"use strict";
// On paper nothing unfolds.
addEventListener("beforeprint", () => { for (const part of document.querySelectorAll("details")) part.open = true; });
(() => {
  const source = document.getElementById("viewer-data");
  if (!source) return;
  const { cases, images } = JSON.parse(source.textContent);
  const $ = (id) => document.getElementById(id);
  const label = (select) => select.options[select.selectedIndex].text;
  let dragging = false;

  function wipe(percent) {
    const p = Math.min(100, Math.max(0, percent));
    $("over").style.clipPath = `inset(0 ${100 - p}% 0 0)`;
    $("bar").style.left = `${p}%`;
    $("position").value = p;
  }

  function show() {
    const found = cases.find((c) => c.scene === $("scene").value && c.graph === $("graph").value);
    if (!found) return;
    $("over").src = images[found[$("left").value]];
    $("under").src = images[found[$("right").value]];
    $("name-left").textContent = label($("left"));
    $("name-right").textContent = label($("right"));
    for (const image of document.querySelectorAll("#four img")) image.src = images[found[image.dataset.view]];
    for (const row of document.querySelectorAll("#choices tbody tr")) row.classList.toggle("chosen", row.dataset.graph === found.graph);
    $("caption").textContent = `${found.scene}, ${found.spp} samples per pixel, ${found.graph}: ${found.text}`;
  }

  // A graph of the scene with its figures, best first; a click shows it.
  function row(found) {
    const line = document.createElement("tr");
    line.dataset.graph = found.graph;
    const name = document.createElement("button");
    name.textContent = found.graph;
    line.insertCell().append(name);
    for (const text of [found.spp, ...found.figures]) {
      const cell = line.insertCell();
      cell.className = "n";
      cell.textContent = text;
    }
    line.addEventListener("click", () => { $("graph").value = found.graph; show(); });
    return line;
  }

  function graphs() {
    const before = $("graph").value;
    const here = cases.filter((c) => c.scene === $("scene").value).sort((a, b) => a.relmse - b.relmse);
    const names = here.map((c) => c.graph);
    $("graph").replaceChildren(...names.map((n) => new Option(n, n)));
    if (names.includes(before)) $("graph").value = before;
    $("choices").tBodies[0].replaceChildren(...here.map(row));
    show();
  }

  function follow(event) {
    const box = $("wipe").getBoundingClientRect();
    wipe((100 * (event.clientX - box.left)) / box.width);
  }

  $("left").value = "noisy";
  $("right").value = "result";
  $("scene").addEventListener("change", graphs);
  for (const id of ["graph", "left", "right"]) $(id).addEventListener("change", show);
  $("position").addEventListener("input", () => wipe(Number($("position").value)));
  $("wipe").addEventListener("pointerdown", (event) => {
    dragging = true;
    if (event.isTrusted) $("wipe").setPointerCapture(event.pointerId);
    follow(event);
  });
  $("wipe").addEventListener("pointermove", (event) => { if (dragging) follow(event); });
  for (const end of ["pointerup", "pointercancel"]) $("wipe").addEventListener(end, () => { dragging = false; });
  const large = cases.find((c) => c.scene.startsWith("Cornell"));
  if (large) $("scene").value = large.scene;
  graphs();
  wipe(50);
})();
