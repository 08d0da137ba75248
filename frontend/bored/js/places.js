// @ts-check
/** The places, in the order of the agent's actions. */

/**
 * @typedef {object} Place
 * @property {string} id
 * @property {string} name as it stands on the door
 * @property {Partial<Record<string, string>>} [names] by language, where it differs
 * @property {string} type one of TYPES in contract.js
 * @property {number} lat
 * @property {number} lon
 * @property {string} address in French
 * @property {import("./hours.js").Hours} [hours]
 * @property {string} [website]
 * @property {string} [wheelchair] as in OpenStreetMap: yes, limited, no
 */

const HOUSE_AND_TOWN = /( \d+\w?)?, 1000 Bruxelles$/;

export class Places {
  /**
   * @param {Place[]} list
   * @param {Record<string, string>} streets the Dutch name of each street, by the French one
   * @param {string} attribution
   */
  constructor(list, streets, attribution) {
    this.attribution = attribution;
    this.list = list;
    this.streets = streets;
    this.numbers = new Map(list.map((place, number) => [place.id, number]));
  }

  /** @param {string} url */
  static async load(url) {
    const { places, streets, attribution } = await (await fetch(url)).json();
    return new Places(places, streets, attribution);
  }

  /**
   * @param {string} id
   * @returns {Place | undefined}
   */
  get(id) {
    const number = this.numbers.get(id);
    return number === undefined ? undefined : this.list[number];
  }

  /**
   * What speakers of a language call it.
   * @param {Place} place
   * @param {string} language
   */
  name(place, language) {
    return place.names?.[language] ?? place.name;
  }

  /**
   * The full address: in Dutch for speakers of Dutch, else in French.
   * @param {Place} place
   * @param {string} language
   */
  address(place, language) {
    if (language !== "nl") return place.address;
    const street = place.address.replace(HOUSE_AND_TOWN, "");
    return place.address.replace(street, this.streets[street] ?? street).replace("Bruxelles", "Brussel");
  }
}

/**
 * @param {Place} place
 * @returns {import("./contract.js").Point}
 */
export function pointOf(place) {
  return [place.lat, place.lon];
}
