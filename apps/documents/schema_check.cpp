#include "apps/documents/schema_check.hpp"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>

#include "apps/documents/json_reader.hpp"
#include "orbits/records/nearest_name.hpp"

namespace orbid::apps {

namespace {

const JsonMember* member(const JsonValue& object, std::string_view key) {
    for (const JsonMember& one : object.members)
        if (one.key == key) return &one;
    return nullptr;
}

bool equal(const JsonValue& a, const JsonValue& b) {
    if (a.kind != b.kind) return false;
    return a.kind == JsonValue::Kind::number ? a.number == b.number : a.text == b.text;
}

bool fits(const NumberSchema& form, double number) {
    if (!form.only.empty()) return std::find(form.only.begin(), form.only.end(), number) != form.only.end();
    if (form.except) return number != *form.except;
    const bool low = form.above_lowest ? number > form.lowest : number >= form.lowest;
    const bool high = form.below_highest ? number < form.highest : number <= form.highest;
    return low && high && (!form.whole || std::trunc(number) == number);
}

class Check {
public:
    explicit Check(std::vector<Problem>& problems) : problems_(problems) {}

    /// @return false when something is wrong with the value or within it
    bool value(JsonValue& at, const std::string& pointer, const ValueSchema& description) {
        if (description.anything) return true;
        if (!description.allows(at.kind))
            return refuse(at, pointer, fmt::format("must be {}, not {}", in_words(description), shown_value(at)));
        switch (at.kind) {
            case JsonValue::Kind::number:
                if (fits(*description.number, at.number)) return true;
                return refuse(at, pointer, fmt::format("must be {}, not {}", rule(*description.number), at.number));
            case JsonValue::Kind::string:
                return text(at, pointer, description);
            case JsonValue::Kind::array:
                return list(at, pointer, *description.list);
            case JsonValue::Kind::object:
                return object(at, pointer, *description.object);
            default:
                return true;
        }
    }

private:
    bool refuse(JsonValue& at, const std::string& pointer, std::string why) {
        at.flaw = JsonValue::Flaw::itself;
        problems_.push_back({at.place, pointer, std::move(why), Problem::Kind::job});
        return false;
    }

    bool text(JsonValue& at, const std::string& pointer, const ValueSchema& description) {
        const TextSchema& form = *description.text;
        if (!form.choices.empty()) {
            if (is_in(at.text, form.choices)) return true;
            // Where nothing like it is known, something else than a word may have been meant.
            const bool near = orbits::nearest_name(at.text, form.choices).has_value();
            const bool others = description.number || description.boolean || description.list || description.object;
            if (others && !near)
                return refuse(at, pointer, fmt::format("must be {}, not {}", in_words(description), shown_value(at)));
            return refuse(at, pointer,
                          fmt::format("unknown value {}{}", shown_value(at), suggestion(at.text, form.choices)));
        }
        if (at.text.size() > longest_json_text)
            return refuse(at, pointer,
                          fmt::format("has {} characters, at most {} are read", at.text.size(), longest_json_text));
        if (form.accepts == nullptr || form.accepts(at.text)) return true;
        return refuse(at, pointer, fmt::format("must be {}, not {}", form.rule, shown_value(at)));
    }

    bool list(JsonValue& at, const std::string& pointer, const ListSchema& form) {
        const std::size_t count = at.items.size();
        if (count < form.fewest || count > form.most) {
            if (!form.rule.empty()) return refuse(at, pointer, fmt::format("must be {}", form.rule));
            if (form.fewest == 1) return refuse(at, pointer, "must not be empty: at least one value");
            return refuse(at, pointer, fmt::format("must hold {} values, not {}", form.fewest, count));
        }
        bool sound = true;
        for (std::size_t i = 0; i < count; ++i) {
            const std::string item_pointer = child_pointer(pointer, std::to_string(i));
            bool item_sound = value(at.items[i], item_pointer, *form.item);
            const auto here = at.items.begin() + static_cast<std::ptrdiff_t>(i);
            const bool twice = form.unique && item_sound &&
                               std::any_of(at.items.begin(), here, [&](const JsonValue& o) { return equal(o, *here); });
            if (twice)
                item_sound = refuse(at.items[i], item_pointer, fmt::format("{} is listed twice", shown_value(*here)));
            sound = sound && item_sound;
        }
        if (!sound) at.flaw = JsonValue::Flaw::within;
        return sound;
    }

    enum class Holds { yes, no, unclear };

    /// Unclear: the key that decides is wrong itself, which is said already.
    static Holds holds(const Condition& condition, const JsonValue& object, const ObjectSchema& form) {
        const JsonMember* found = member(object, condition.key);
        if (condition.values.empty()) {
            if (found == nullptr && !condition.or_key.empty()) found = member(object, condition.or_key);
            if (found == nullptr) return Holds::no;
            return found->value.flaw == JsonValue::Flaw::itself ? Holds::unclear : Holds::yes;
        }
        const KeySchema* described = form.find(condition.key);
        if (found == nullptr) {
            if (described == nullptr || described->required) return Holds::unclear;
            const bool usual = std::any_of(condition.values.begin(), condition.values.end(), [&](const auto& value) {
                return described->default_value == fmt::format("\"{}\"", value);
            });
            return usual ? Holds::yes : Holds::no;
        }
        if (found->value.flaw != JsonValue::Flaw::none) return Holds::unclear;
        return is_in(found->value.text, condition.values) ? Holds::yes : Holds::no;
    }

    static std::string in_words_of(const Condition& condition) {
        if (!condition.or_key.empty())
            return fmt::format("\"{}\" or \"{}\", which are missing", condition.key, condition.or_key);
        if (condition.values.empty()) return fmt::format("\"{}\", which is missing", condition.key);
        std::string list;
        for (const std::string& each : condition.values)
            list += fmt::format("{}\"{}\"", list.empty() ? "" : " or ", each);
        return fmt::format("\"{}\": {}", condition.key, list);
    }

    /// Why a key must not stand here; empty when it may.
    static std::string against(const KeySchema& entry, const JsonValue& object, const ObjectSchema& form) {
        if (!entry.refused.empty()) return entry.refused;
        if (entry.never_beside && member(object, *entry.never_beside) != nullptr)
            return fmt::format("does not go with \"{}\": one of the two must be left out", *entry.never_beside);
        if (entry.only_with && holds(*entry.only_with, object, form) == Holds::no)
            return "belongs to " + in_words_of(*entry.only_with);
        return {};
    }

    bool member_value(JsonMember& one, const JsonValue& object, const std::string& pointer, const ObjectSchema& form) {
        const std::string at = child_pointer(pointer, one.key);
        const KeySchema* entry = form.find(one.key);
        if (entry == nullptr && form.entries) return value(one.value, at, *form.entries->value);
        std::string why;
        if (entry == nullptr) {
            std::vector<std::string> known;
            for (const KeySchema& each : form.keys)
                if (against(each, object, form).empty()) known.push_back(each.key);
            why = "unknown key" + suggestion(one.key, known);
        } else {
            why = against(*entry, object, form);
        }
        if (why.empty()) return value(one.value, at, entry->value);
        one.value.flaw = JsonValue::Flaw::itself;
        problems_.push_back({one.place, at, std::move(why), Problem::Kind::job});
        return false;
    }

    bool object(JsonValue& at, const std::string& pointer, const ObjectSchema& form) {
        bool sound = true;
        // Keys that others depend on may stand behind these: they are checked first.
        for (const bool conditional : {false, true}) {
            for (JsonMember& one : at.members) {
                const KeySchema* entry = form.find(one.key);
                if (conditional != (entry == nullptr || entry->only_with || entry->never_beside)) continue;
                sound = member_value(one, at, pointer, form) && sound;
            }
        }
        const auto report = [&](std::string why) {
            problems_.push_back({at.place, pointer, std::move(why), Problem::Kind::job});
            sound = false;
        };
        // An unknown key may well be the one that is missing.
        if (!form.exactly_one.empty()) sound = exactly_one(at, pointer, form, sound) && sound;
        for (const KeySchema& entry : form.keys) {
            if (member(at, entry.key) != nullptr) continue;
            const bool here = entry.required && !(entry.never_beside && member(at, *entry.never_beside) != nullptr) &&
                              (!entry.only_with || holds(*entry.only_with, at, form) == Holds::yes);
            const bool there = entry.required_with && holds(*entry.required_with, at, form) == Holds::yes;
            const bool instead = entry.required_unless && member(at, *entry.required_unless) == nullptr;
            if (here || there || instead)
                report(fmt::format("\"{}\" is missing: {}. {}", entry.key, in_words(entry.value), entry.text));
        }
        if (at.members.size() < form.fewest)
            report(fmt::format("must not be empty: at least one entry, named after {}",
                               form.entries ? form.entries->names : "a key"));
        if (!sound) at.flaw = JsonValue::Flaw::within;
        return sound;
    }

    bool exactly_one(JsonValue& at, const std::string& pointer, const ObjectSchema& form, bool needed) {
        const JsonMember* first = nullptr;
        bool sound = true;
        for (JsonMember& one : at.members) {
            if (!is_in(one.key, form.exactly_one)) continue;
            if (first == nullptr) {
                first = &one;
                continue;
            }
            problems_.push_back({one.place, child_pointer(pointer, one.key),
                                 fmt::format("stands beside \"{}\": one of the two must be left out", first->key),
                                 Problem::Kind::job});
            one.value.flaw = JsonValue::Flaw::itself;
            sound = false;
        }
        if (first != nullptr || !needed) return sound;
        std::string list;
        for (std::size_t i = 0; i < form.exactly_one.size(); ++i) {
            const bool last = i + 1 == form.exactly_one.size();
            list += fmt::format("{}\"{}\"", i == 0 ? "" : last ? " or " : ", ", form.exactly_one[i]);
        }
        problems_.push_back({at.place, pointer, "needs " + list, Problem::Kind::job});
        return false;
    }

    std::vector<Problem>& problems_;
};

}  // namespace

void check_described(JsonValue& value, const ValueSchema& description, std::vector<Problem>& problems) {
    Check(problems).value(value, "", description);
}

}  // namespace orbid::apps
