#pragma once

#include <algorithm>
#include <functional>
#include <optional>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include <nlohmann/json.hpp>

#include "apps/job/blocks/field_table.hpp"

namespace orbid::apps {

// Kinds of fields: how a member of a block is described, read and written.

/// The member of a member (of a member ...) of a block: each step is a pointer to a member, or a function.
template <class Block, class Step, class... Steps>
[[nodiscard]] auto& member_of(Block& block, const Step& step, const Steps&... steps) {
    auto& inner = std::invoke(step, block);
    if constexpr (sizeof...(steps) == 0) {
        return inner;
    } else {
        return member_of(inner, steps...);
    }
}

/// A key that is refused with a reason of its own.
template <class Block>
[[nodiscard]] Field<Block> refused_field(KeySchema key) {
    return {std::move(key), read_later<Block>, [](const Block&, const Writing&) { return left_out(); }};
}

/// A number, truth value, text or list whose default is not a fixed one, or that has none. An optional value is
/// written where it is there.
template <class Block, class First, class... Rest>
[[nodiscard]] Field<Block> open_field(KeySchema key, First Block::*first, Rest... rest) {
    return {std::move(key),
            [=](const ValueReader& value, const Job&, Block& block) { value.read(member_of(block, first, rest...)); },
            [=](const Block& block, const Writing&) -> nlohmann::ordered_json {
                const auto& member = member_of(block, first, rest...);
                if constexpr (std::is_same_v<std::decay_t<decltype(member)>, std::optional<double>>) {
                    if (!member) return left_out();
                    return *member;
                } else {
                    return member;
                }
            }};
}

/// The same with the default of the struct.
template <class Block, class First, class... Rest>
[[nodiscard]] Field<Block> field(KeySchema key, First Block::*first, Rest... rest) {
    const Block usual{};
    const auto& member = member_of(usual, first, rest...);
    if constexpr (std::is_same_v<std::decay_t<decltype(member)>, std::string>) {
        key.by_default(member.c_str());
    } else {
        key.by_default(member);
    }
    return open_field(std::move(key), first, rest...);
}

/// A text that is written where it is not empty.
template <class Block>
[[nodiscard]] Field<Block> text_field(KeySchema key, std::string Block::*member) {
    return open_field(std::move(key), member).written_if([member](const Block& block) {
        return !(block.*member).empty();
    });
}

/// The values of a member, each with the word that a job has for it.
template <class Block, class... Steps>
using Words = std::vector<
    std::pair<std::decay_t<decltype(member_of(std::declval<Block&>(), std::declval<Steps>()...))>, std::string>>;

/// One of several words, in the order of the schema, for a truth value or some values of an enumeration.
template <class Block, class First, class... Rest>
[[nodiscard]] Field<Block> word_field(KeySchema key, const Words<Block, First Block::*, Rest...>& words,
                                      First Block::*first, Rest... rest) {
    std::vector<std::string> names;
    for (const auto& [value, word] : words)
        names.push_back(word);
    const auto word_of = [words](auto value) {
        return std::find_if(words.begin(), words.end(), [&](const auto& one) { return one.first == value; })->second;
    };
    const Block usual{};
    if (!key.required) key.by_default(word_of(member_of(usual, first, rest...)).c_str());
    key.value = describe::choice(names);
    return {std::move(key),
            [=](const ValueReader& value, const Job&, Block& block) {
                if (const auto index = value.choice(names)) member_of(block, first, rest...) = words[*index].first;
            },
            [=](const Block& block, const Writing&) -> nlohmann::ordered_json {
                return word_of(member_of(block, first, rest...));
            }};
}

/// The same for all values of an enumeration, which these names are in the order of.
template <class Block, class First, class... Rest>
[[nodiscard]] Field<Block> choice_field(KeySchema key, const std::vector<std::string>& names, First Block::*first,
                                        Rest... rest) {
    Words<Block, First Block::*, Rest...> words(names.size());
    for (std::size_t i = 0; i < names.size(); ++i)
        words[i] = {static_cast<decltype(words[i].first)>(i), names[i]};
    return word_field(std::move(key), words, first, rest...);
}

/// The name of a coordinate; `member` is its index, and stays where the name is unknown.
template <class Block, class Index>
[[nodiscard]] Field<Block> coordinate_field(KeySchema key, Index Block::*member) {
    return {std::move(key),
            [member](const ValueReader& value, const Job& job, Block& block) {
                const auto name = value.text();
                if (!name) return;
                if (const auto index = coordinate_named(*name, value, job)) block.*member = static_cast<Index>(*index);
            },
            [member](const Block& block, const Writing& at) -> nlohmann::ordered_json {
                return coordinate_name(at.job, static_cast<Eigen::Index>(block.*member));
            }};
}

/// An existing file beside the job.
template <class Block>
[[nodiscard]] Field<Block> file_field(KeySchema key, std::optional<std::filesystem::path> Block::*member) {
    return {std::move(key),
            [member](const ValueReader& value, const Job& job, Block& block) { block.*member = read_path(value, job); },
            [member](const Block& block, const Writing& at) -> nlohmann::ordered_json {
                if (!(block.*member)) return left_out();
                return path_text(*(block.*member), at.folder);
            }};
}

/// The fields of a part whose keys stand in the block itself. `access` gives the part of a block, constant or not: a
/// member, or a function. The part must be there where its keys may stand.
template <class Block, class Part, class Access>
void add_fields_of(FieldTable<Block>& table, const FieldTable<Part>& fields, Access access) {
    for (const Field<Part>& one : fields) {
        table.push_back({one.key,
                         [&one, access](const ValueReader& value, const Job& job, Block& block) {
                             one.read(value, job, std::invoke(access, block));
                         },
                         [&one, access](const Block& block, const Writing& at) {
                             return one.write(std::invoke(access, block), at);
                         }});
        table.back().write_after = one.write_after;
        table.back().later_than = one.later_than;
    }
}

/// An object with the keys of a part, or of the block itself (std::identity). An optional part is there with its key.
template <class Block, class Part, class Access>
[[nodiscard]] Field<Block> object_field(KeySchema key, const FieldTable<Part>& fields, Access access) {
    key.value = describe::object(keys_of(fields));
    return {std::move(key),
            [&fields, access](const ValueReader& value, const Job& job, Block& block) {
                auto& part = std::invoke(access, block);
                if constexpr (requires { part.emplace(); }) {
                    read_object(value, fields, part.emplace(), job);
                } else {
                    read_object(value, fields, part, job);
                }
            },
            [&fields, access](const Block& block, const Writing& at) {
                const auto& part = std::invoke(access, block);
                if constexpr (requires { part.has_value(); }) {
                    return part ? fields_document(*part, fields, at) : left_out();
                } else {
                    return fields_document(part, fields, at);
                }
            }};
}

}  // namespace orbid::apps
