// @ts-check
/** What the page says, in the visitor's language: lang/*.json. */

export const LANGUAGES = /** @type {const} */ ({ en: "English", fr: "Français", nl: "Nederlands" });

/**
 * The first of these languages that the page speaks.
 * @param {readonly (string | null)[]} wishes as in navigator.languages: "nl-BE"
 */
export function chooseLanguage(wishes) {
  const spoken = wishes.map((wish) => (wish ?? "").slice(0, 2).toLowerCase());
  return spoken.find((language) => language in LANGUAGES) ?? "en";
}

export class Texts {
  /**
   * @param {string} language
   * @param {Record<string, string>} sentences by their keys
   */
  constructor(language, sentences) {
    this.language = language;
    this.sentences = sentences;
  }

  /** @param {string} language */
  static async load(language) {
    return new Texts(language, await (await fetch(`lang/${language}.json`)).json());
  }

  /**
   * A sentence, with what stands in braces filled in.
   * @param {string} key
   * @param {Record<string, string | number>} [values]
   */
  say(key, values = {}) {
    return this.sentences[key].replace(/\{(\w+)\}/g, (_, name) => String(values[name]));
  }

  /**
   * 480 m, 1.2 km
   * @param {number} metres
   */
  distance(metres) {
    const far = metres >= 1000;
    const value = far ? metres / 1000 : Math.round(metres / 10) * 10;
    const options = { style: "unit", unit: far ? "kilometer" : "meter", maximumFractionDigits: far && value < 100 ? 1 : 0 };
    return new Intl.NumberFormat(this.language, /** @type {Intl.NumberFormatOptions} */ (options)).format(value);
  }

  /** @param {number} share 0 to 1 */
  percent(share) {
    return new Intl.NumberFormat(this.language, { style: "percent" }).format(share);
  }

  /**
   * Translate the page: elements say in `data-text` what they contain, in `data-label` what they are called.
   * @param {ParentNode} page
   */
  fill(page) {
    for (const node of page.querySelectorAll("[data-text]")) {
      node.textContent = this.say(node.getAttribute("data-text") ?? "");
    }
    for (const node of page.querySelectorAll("[data-label]")) {
      node.setAttribute("aria-label", this.say(node.getAttribute("data-label") ?? ""));
    }
  }
}
