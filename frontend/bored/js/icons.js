// @ts-check
/** Icons: <symbol>s of index.html. */

const SVG = "http://www.w3.org/2000/svg";

/** @param {string} name */
export function icon(name) {
  const svg = document.createElementNS(SVG, "svg");
  svg.setAttribute("class", "icon");
  svg.setAttribute("aria-hidden", "true");
  const use = document.createElementNS(SVG, "use");
  use.setAttribute("href", `#icon-${name}`);
  svg.append(use);
  return svg;
}

/** The body of a pin of the map. */
export function pin() {
  const body = document.createElement("div");
  body.className = "body";
  return body;
}
