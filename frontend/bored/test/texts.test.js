import assert from "node:assert/strict";
import { readdirSync, readFileSync } from "node:fs";
import { test } from "node:test";

import { Places } from "../js/places.js";
import { chooseLanguage, LANGUAGES, Texts } from "../js/texts.js";

const home = new URL("../", import.meta.url);
const read = (path) => readFileSync(new URL(path, home), "utf8");
const sentences = Object.fromEntries(Object.keys(LANGUAGES).map((code) => [code, JSON.parse(read(`lang/${code}.json`))]));
const braces = (sentence) => [...sentence.matchAll(/\{\w+\}/g)].map(([name]) => name).sort();

test("every language says everything, with the same values in it", () => {
  for (const [language, own] of Object.entries(sentences)) {
    assert.deepEqual(Object.keys(own), Object.keys(sentences.en), language);
    for (const key of Object.keys(own)) assert.deepEqual(braces(own[key]), braces(sentences.en[key]), `${language}: ${key}`);
  }
});

test("everything that the page says has its sentence, and every sentence is said", () => {
  const sources = ["index.html", ...readdirSync(new URL("js", home), { recursive: true }).map((file) => `js/${file}`)];
  const code = sources.filter((file) => /\.(js|html)$/.test(file)).map(read).join("");
  const named = [...code.matchAll(/(?:say\("|data-text="|data-label=")([\w.-]+)"/g)].map(([, key]) => key);
  assert.deepEqual(named.filter((key) => !(key in sentences.en)), []);
  const composed = /^(type|wheelchair|privacy\.kept|snack)\.|^(open|opens|closed|always)$/;
  const unsaid = Object.keys(sentences.en).filter((key) => !composed.test(key) && !code.includes(`"${key}"`));
  assert.deepEqual(unsaid, []);
});

test("the visitor's first language that the page speaks is taken", () => {
  assert.equal(chooseLanguage([null, "de-DE", "nl-BE", "fr"]), "nl");
  assert.equal(chooseLanguage(["fr", "nl-BE"]), "fr");
  assert.equal(chooseLanguage(["ja"]), "en");
});

test("distances are said as people say them", () => {
  const texts = new Texts("fr", { walk: "{minutes} min, {minutes}" });
  assert.equal(texts.distance(384).replace(/\s/, " "), "380 m");
  assert.equal(texts.distance(1234).replace(/\s/, " "), "1,2 km");
  assert.equal(texts.say("walk", { minutes: 5 }), "5 min, 5");
});

test("addresses are in Dutch for speakers of Dutch", () => {
  const { places, streets } = JSON.parse(read("places.json"));
  const all = new Places(places, streets, "");
  const leon = all.get("chez-leon");
  assert.equal(all.address(leon, "nl"), "Beenhouwersstraat 18, 1000 Brussel");
  assert.equal(all.address(leon, "en"), "Rue des Bouchers 18, 1000 Bruxelles");
  assert.equal(all.name(all.get("parc-de-bruxelles"), "nl"), "Warandepark");
  assert.equal(all.get("nowhere"), undefined);
});
