#pragma once

#include <algorithm>
#include <functional>
#include <optional>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include <nlohmann/json.hpp>

#include "apps/documents/json_reader.hpp"
#include "apps/documents/schema.hpp"
#include "apps/job/blocks/document_parts.hpp"
#include "apps/job/job.hpp"

namespace orbid::apps {

/// A job without a model, for blocks that need nothing of their job.
[[nodiscard]] const Job& no_job();

/// Where a block is written.
struct Writing {
    const Job& job;
    std::filesystem::path folder = {};  ///< paths are written relative to it
};

/// What stands for a key that is not written.
[[nodiscard]] inline nlohmann::ordered_json left_out() {
    return nlohmann::ordered_json(nlohmann::ordered_json::value_t::discarded);
}

/// A key of a job: what the schema says of it, how it is read, how it is written. A block's table of these is the only
/// place that states its keys; schema, reference page, checks, reader and writer walk over it.
template <class Block>
struct Field {
    using Read = std::function<void(const ValueReader& value, const Job& job, Block& block)>;
    using Write = std::function<nlohmann::ordered_json(const Block& block, const Writing& at)>;

    Field(KeySchema described, Read reader, Write writer)
        : key(std::move(described)), read(std::move(reader)), write(std::move(writer)) {}

    /// In job.json it follows this key, not the one before it in the table.
    [[nodiscard]] Field written_after(std::string other) && {
        after = std::move(other);
        return std::move(*this);
    }

    KeySchema key;
    Read read;    ///< called where the key is there and described rightly
    Write write;  ///< left_out() where job.json has no such key
    std::string after;
};

/// The keys of a block in the order of the schema; they are read in this order.
template <class Block>
using FieldTable = std::vector<Field<Block>>;

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
    return {std::move(key), [](const ValueReader&, const Job&, Block&) {},
            [](const Block&, const Writing&) { return left_out(); }};
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
    Field<Block> made = open_field(std::move(key), member);
    made.write = [member](const Block& block, const Writing&) -> nlohmann::ordered_json {
        if ((block.*member).empty()) return left_out();
        return block.*member;
    };
    return made;
}

/// One of several names, in the order of the enumeration; `names` must live as long as the table.
template <class Block, class First, class... Rest>
[[nodiscard]] Field<Block> choice_field(KeySchema key, const std::vector<std::string>& names, First Block::*first,
                                        Rest... rest) {
    const Block usual{};
    key.value = describe::choice(names);
    key.by_default(names[static_cast<std::size_t>(member_of(usual, first, rest...))].c_str());
    return {std::move(key),
            [=, &names](const ValueReader& value, const Job&, Block& block) {
                value.choose(names, member_of(block, first, rest...));
            },
            [=, &names](const Block& block, const Writing&) -> nlohmann::ordered_json {
                return names[static_cast<std::size_t>(member_of(block, first, rest...))];
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

template <class Block>
[[nodiscard]] std::vector<KeySchema> keys_of(const FieldTable<Block>& fields) {
    std::vector<KeySchema> keys;
    for (const Field<Block>& one : fields)
        keys.push_back(one.key);
    return keys;
}

template <class Block>
void read_fields(ObjectReader& object, const FieldTable<Block>& fields, Block& block, const Job& job = no_job()) {
    for (const Field<Block>& one : fields)
        if (const auto value = object.find(one.key.key)) one.read(*value, job, block);
}

/// Reads an object that has these keys alone.
template <class Block>
void read_object(const ValueReader& value, const FieldTable<Block>& fields, Block& block, const Job& job = no_job()) {
    ObjectReader object(value);
    read_fields(object, fields, block, job);
    object.finish();
}

/// Whether a key may stand in an object so far as it is written.
[[nodiscard]] bool may_be_written(const KeySchema& key, const nlohmann::ordered_json& object);

/// The object of a block. Keys that another one excludes or does not allow are left out, whatever the block holds.
template <class Block>
[[nodiscard]] nlohmann::ordered_json fields_document(const Block& block, const FieldTable<Block>& fields,
                                                     const Writing& at = {no_job()}) {
    auto object = nlohmann::ordered_json::object();
    const auto write = [&](const auto& self, const std::string& after) -> void {
        for (const Field<Block>& one : fields) {
            if (one.after != after) continue;
            if (may_be_written(one.key, object))
                if (auto value = one.write(block, at); !value.is_discarded()) object[one.key.key] = std::move(value);
            self(self, one.key.key);
        }
    };
    write(write, "");
    return object;
}

/// A list of objects that have these keys.
template <class Block>
[[nodiscard]] nlohmann::ordered_json list_document(const std::vector<Block>& blocks, const FieldTable<Block>& fields,
                                                   const Writing& at) {
    auto list = nlohmann::ordered_json::array();
    for (const Block& block : blocks)
        list.push_back(fields_document(block, fields, at));
    return list;
}

/// The fields of a part whose keys stand in the block itself. `access` gives the part of a block, constant or not.
template <class Block, class Part, class Access>
void add_fields_of(FieldTable<Block>& table, const FieldTable<Part>& fields, Access access) {
    for (const Field<Part>& one : fields)
        table.push_back(
            {one.key,
             [&one, access](const ValueReader& value, const Job& job, Block& block) {
                 one.read(value, job, access(block));
             },
             [&one, access](const Block& block, const Writing& at) { return one.write(access(block), at); }});
}

}  // namespace orbid::apps
