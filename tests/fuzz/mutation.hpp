#pragma once

#include <filesystem>
#include <functional>
#include <random>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

namespace orbid::fuzz {

/// Changes the content of a file: JSON by its structure, anything else by its bytes, and JSON sometimes by its bytes,
/// too. The same random numbers give the same change.
class Mutation {
public:
    using Json = nlohmann::ordered_json;

    explicit Mutation(std::mt19937_64& random) : random_(random) {}

    [[nodiscard]] std::string of(std::string bytes, const std::filesystem::path& extension) {
        if (extension == ".json" && below(4) > 0) {
            Json json = Json::parse(bytes, nullptr, false, true);
            if (!json.is_discarded()) return structure(std::move(json));
        }
        for (std::size_t i = 0, times = 1 + below(4); i < times; ++i)
            change_bytes(bytes);
        return bytes;
    }

private:
    std::size_t below(std::size_t count) { return count == 0 ? 0 : random_() % count; }

    /// Values that a reader may take for what it expects.
    Json hostile_value() {
        static const std::vector<Json> values{nullptr,
                                              true,
                                              false,
                                              0,
                                              1,
                                              -1,
                                              2,
                                              0.5,
                                              -0.5,
                                              1e300,
                                              -1e300,
                                              1e-300,
                                              9007199254740992,
                                              18446744073709551615U,
                                              4294967296,
                                              2147483648,
                                              -2147483649,
                                              "",
                                              "nonsense",
                                              "../../x",
                                              "/etc/passwd",
                                              "</script><script>alert(1)",
                                              "\x1b]0;x\x07\x1b[2J",
                                              std::string(5000, 'a'),
                                              Json::array(),
                                              Json::object(),
                                              Json::array({0}),
                                              Json::array({Json::array({1, 2})}),
                                              {{"value", 1}},
                                              {{"x", "y"}}};
        return values[below(values.size())];
    }

    std::string structure(Json json) {
        std::vector<Json*> all;
        const std::function<void(Json&)> collect = [&](Json& value) {
            all.push_back(&value);
            if (value.is_structured())
                for (Json& part : value)
                    collect(part);
        };
        collect(json);
        // Near the root as often as deep within: lists of numbers would take all changes.
        std::vector<Json*> structured;
        for (Json* value : all)
            if (value->is_structured() && !value->empty()) structured.push_back(value);
        Json& parent = below(2) == 0 && !structured.empty() ? *structured[below(structured.size())] : json;
        if (!parent.is_structured() || parent.empty()) return hostile_value().dump();
        auto at = parent.begin();
        std::advance(at, static_cast<std::ptrdiff_t>(below(parent.size())));
        const bool listed = parent.is_array();
        switch (below(listed ? 8 : 6)) {
            case 0:
                parent.erase(at);
                break;
            case 1:
                *at = *all[below(all.size())];
                break;
            case 2: {
                // What no value of the library can hold.
                static const std::vector<std::string> texts{"1e9991",
                                                            "-1e9991",
                                                            "1e-9991",
                                                            "99999999999999999999999",
                                                            std::string(100000, '['),
                                                            "[[[[[[[[1]]]]]]]]",
                                                            "NaN"};
                *at = "@@";
                std::string text = json.dump(1, ' ', false, Json::error_handler_t::replace);
                const std::size_t place = text.find("\"@@\"");
                return text.replace(place, 4, texts[below(texts.size())]);
            }
            case 6:
                parent.push_back(parent[below(parent.size())]);
                break;
            case 7:
                parent.erase(parent.begin() + static_cast<std::ptrdiff_t>(below(parent.size())), parent.end());
                break;
            default:
                *at = hostile_value();
        }
        return json.dump(1, ' ', false, Json::error_handler_t::replace);
    }

    void change_bytes(std::string& bytes) {
        if (bytes.empty()) {
            bytes = std::string(below(100), static_cast<char>(below(256)));
            return;
        }
        const std::size_t at = below(bytes.size()), length = below(std::min<std::size_t>(bytes.size() - at, 64) + 1);
        switch (below(7)) {
            case 0:
                bytes[at] = static_cast<char>(below(256));
                break;
            case 1:
                bytes[at] = static_cast<char>(bytes[at] ^ (1 << below(8)));
                break;
            case 2:
                bytes.resize(at);
                break;
            case 3:
                bytes.erase(at, length);
                break;
            case 4:
                bytes.insert(at, bytes.substr(below(bytes.size()), length));
                break;
            case 5:
                bytes.replace(at, length, std::string(length, static_cast<char>(below(2) == 0 ? 0xFF : 0)));
                break;
            default: {
                static const std::vector<std::string> words{
                    "1e9991",  "-1", "nan", "\"", ",", "\n", "\xff\xff\xff\xff", "9223372036854775807",
                    "\x1b[2J", "\r", "{",   "["};
                bytes.insert(at, words[below(words.size())]);
            }
        }
    }

    std::mt19937_64& random_;
};

}  // namespace orbid::fuzz
