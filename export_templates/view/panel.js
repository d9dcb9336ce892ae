// What stands beside the plate: dies, layers, rules, and the file. All words come in as text, never as markup.

function element(name, words, attributes) {
  const made = document.createElement(name);
  if (words !== undefined) made.textContent = words;
  for (const [key, value] of Object.entries(attributes || {})) made.setAttribute(key, value);
  return made;
}

function byId(name) {
  return document.getElementById(name);
}

/** A row with a box to tick, a swatch painted by `paint`, and words. */
function tickRow(words, ticked, paint, changed) {
  const row = element("label", undefined, { class: "row" });
  const tick = element("input", undefined, { type: "checkbox" });
  tick.checked = ticked;
  tick.addEventListener("change", () => changed(tick.checked));
  row.append(tick);
  if (paint) {
    const swatch = element("canvas", undefined, { width: 52, height: 32, "aria-hidden": "true" });
    paint(swatch.getContext("2d"));
    row.append(swatch);
  }
  row.append(element("span", words));
  return row;
}

function paintSwatch(context, look) {
  context.setTransform(2, 0, 0, 2, 0, 0);
  context.fillStyle = look.fill;
  context.fillRect(0, 0, 26, 16);
  if (look.hatch) {
    look.hatch.setTransform(new DOMMatrix());
    context.fillStyle = look.hatch;
    context.fillRect(0, 0, 26, 16);
  }
}

function listLayers(layers, looks, shown, changed) {
  const rows = looks.slice().reverse().map((look) => {
    const layer = layers[look.place];
    const words = [layer.name, layer.numbers, layer.purpose && `– ${layer.purpose}`].filter(Boolean).join(" ");
    return tickRow(words, shown.has(look.place), (context) => paintSwatch(context, look), (on) => {
      if (on) shown.add(look.place);
      else shown.delete(look.place);
      changed();
    });
  });
  const dark = layers.some((layer) => layer.name === "CHROME");
  rows.push(element("p", `Where nothing is drawn: ${dark ? "clear glass" : "chrome"}.`, { class: "quiet" }));
  byId("layers").replaceChildren(...rows);
}

function listDies(dies, choose) {
  const buttons = dies.map((die, place) => {
    const button = element("button", `${die.best ? "★ " : ""}${die.name}`, { type: "button", "aria-pressed": "false" });
    button.title = die.best ? `${die.name}: no other is better for sure` : die.name;
    button.addEventListener("click", () => choose(place));
    return button;
  });
  byId("dies").replaceChildren(...buttons);
}

/** The chosen die's numbers and PSF; null for none. */
function tellDie({ dies, beside }, place) {
  [...byId("dies").children].forEach((button, at) => button.setAttribute("aria-pressed", String(at === place)));
  byId("chosen").hidden = place === null;
  if (place === null) return;
  const die = dies[place];
  byId("chosen-name").textContent = `${die.best ? "★ " : ""}${die.name}`;
  byId("chosen-label").textContent = die.label;
  byId("chosen-rows").replaceChildren(...die.rows.map(([heading, value]) => {
    const row = element("tr");
    row.append(element("th", heading, { scope: "row" }), element("td", value));
    return row;
  }));
  const picture = byId("chosen-psf");
  picture.hidden = !die.psf;
  if (die.psf) {
    picture.src = die.psf;
    picture.alt = `${die.name}: ${die.psf_words}`;
  }
  byId("chosen-links").replaceChildren(...(beside === null ? [] : linksOf(die, beside)));
  byId("chosen").scrollIntoView({ block: "nearest" });
  byId("chosen-words").textContent = die.psf ? die.psf_words : "The report holds no PSF of this die.";
}

/** To what the pages beside this one tell of a die. */
function linksOf(die, beside) {
  const pages = [["Its numbers", `appendix.html#numbers-${die.name}`], ["its figures", `appendix.html#die-${die.name}`]];
  if (die.in_report) pages.push(["in the report", `report.html#die-${die.name}`]);
  return pages.flatMap(([words, page], at) => [at ? ", " : "", element("a", words, { href: beside + page })]);
}

/** Rules with the number of their places, ticked to be shown, and buttons from place to place. */
function listRules(told, rules, step, changed) {
  const rows = [];
  for (const rule of rules) {
    const count = rule.places.length / 4;
    const row = tickRow(`${rule.name}: ${rule.description}`, true, null, (on) => {
      rule.shown = on;
      changed();
    });
    rows.push(row);
    for (const words of rule.told) {
      const owner = /^die (\w+):/.exec(words), asked = new URLSearchParams({ rule: rule.name, ...(owner && { die: owner[1] }) });
      const row = element("p", undefined, { class: "quiet" });
      row.append(element("a", words, { href: `#${asked}` }));
      rows.push(row);
    }
    rows.push(element("p", count ? `${count} places here` : "no place told", { class: "quiet" }));
  }
  if (!rules.length) {
    rows.push(element("p", told.markers.length ? "None: no rule is broken." : "The run holds no markers of rules."));
  } else {
    const buttons = element("p", undefined, { class: "buttons" });
    for (const [words, by] of [["Previous place (P)", -1], ["Next place (N)", 1]]) {
      const button = element("button", words, { type: "button" });
      button.addEventListener("click", () => step(by));
      buttons.append(button);
    }
    rows.push(buttons);
  }
  byId("rules").replaceChildren(...rows);
}

function tellFile(told) {
  const rows = [
    ["Mask file, read back", told.file.path], ["Format", told.file.format],
    ["Read", told.readers], ["Bytes", String(told.file.bytes)], ["SHA-256", told.file.sha256, "mono"],
    ["Job hash", told.job_hash, "mono"], ["maskfab", told.maskfab_version],
  ];
  for (const layer of told.layers.filter((each) => each.drawn)) {
    const [left, bottom, right, top] = layer.box.map((side) => side / 1000);
    rows.push([layer.name, `${layer.drawn} shapes in (${left}, ${bottom}) to (${right}, ${top}) um`]);
  }
  byId("file").replaceChildren(...rows.flatMap(([heading, words, kind]) => [
    element("dt", heading), element("dd", words, kind ? { class: kind } : {}),
  ]));
  byId("source").textContent = `${told.file.path}, SHA-256 ${told.file.sha256.slice(0, 16)}…`;
  if (told.beside === null) return;
  const pages = [["report", "report.html"], ["appendix", "appendix.html"], ["numbers.csv", "numbers.csv"]];
  byId("pages").replaceChildren(...pages.map(([words, page]) => element("a", words, { href: told.beside + page })));
}
