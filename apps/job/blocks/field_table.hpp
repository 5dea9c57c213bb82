#pragma once

#include <algorithm>
#include <functional>
#include <optional>
#include <string>
#include <string_view>
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
        write_after = std::move(other);
        return std::move(*this);
    }
    /// It is read after this key, although it is described elsewhere.
    [[nodiscard]] Field read_after(std::string other) && {
        later_than = std::move(other);
        return std::move(*this);
    }
    /// What else is checked or set once the value is read.
    [[nodiscard]] Field with_rule(Read rule) && {
        read = [first = std::move(read), rule = std::move(rule)](const ValueReader& value, const Job& job,
                                                                 Block& block) {
            first(value, job, block);
            rule(value, job, block);
        };
        return std::move(*this);
    }
    /// job.json has it only then.
    [[nodiscard]] Field written_if(std::function<bool(const Block&)> holds) && {
        write = [all = std::move(write), holds = std::move(holds)](const Block& block, const Writing& at) {
            return holds(block) ? all(block, at) : left_out();
        };
        return std::move(*this);
    }

    KeySchema key;
    Read read;    ///< called where the key is there; what the schema has refused reads as nothing
    Write write;  ///< left_out() where job.json has no such key
    std::string write_after;
    std::string later_than;
};

/// The keys of a block in the order of the schema. They are read and written in this order, unless one says otherwise.
template <class Block>
using FieldTable = std::vector<Field<Block>>;

/// Visits all fields: those that name another one in `after` follow it, the others keep their order.
template <class Block, class Visit>
void visit_fields(const FieldTable<Block>& fields, std::string Field<Block>::*after, const Visit& visit,
                  const std::string& previous = "") {
    for (const Field<Block>& one : fields) {
        if (one.*after != previous) continue;
        visit(one);
        visit_fields(fields, after, visit, one.key.key);
    }
}

/// The field of a key; nullptr when there is none.
template <class Block>
[[nodiscard]] const Field<Block>* find_field(const FieldTable<Block>& fields, std::string_view key) {
    const auto found = std::find_if(fields.begin(), fields.end(), [&](const auto& one) { return one.key.key == key; });
    return found != fields.end() ? &*found : nullptr;
}

/// For a key that is read by hand, when all others are.
template <class Block>
void read_later(const ValueReader&, const Job&, Block&) {}

template <class Block>
[[nodiscard]] std::vector<KeySchema> keys_of(const FieldTable<Block>& fields) {
    std::vector<KeySchema> keys;
    for (const Field<Block>& one : fields)
        keys.push_back(one.key);
    return keys;
}

/// Reads the keys that are there. One that belongs to a missing key has been refused, and is not counted as known.
template <class Block>
void read_fields(ObjectReader& object, const FieldTable<Block>& fields, Block& block, const Job& job = no_job()) {
    visit_fields(fields, &Field<Block>::later_than, [&](const Field<Block>& one) {
        const auto& other = one.key.only_with;
        if (other && other->values.empty() && !object.find(other->key) &&
            (other->or_key.empty() || !object.find(other->or_key)))
            return;
        if (const auto value = object.find(one.key.key)) one.read(*value, job, block);
    });
}

/// Reads an object that has these keys alone.
template <class Block>
void read_object(const ValueReader& value, const FieldTable<Block>& fields, Block& block, const Job& job = no_job()) {
    ObjectReader object(value);
    read_fields(object, fields, block, job);
    object.finish();
}

/// The same, or the value of one key in the place of the object: "t" for { "column": "t" }.
template <class Block>
void read_short_or_object(const ValueReader& value, const std::string& short_key, const FieldTable<Block>& fields,
                          Block& block, const Job& job = no_job()) {
    if (value.is(JsonValue::Kind::object)) return read_object(value, fields, block, job);
    find_field(fields, short_key)->read(value, job, block);
}

/// Whether a key may stand in an object so far as it is written.
[[nodiscard]] bool may_be_written(const KeySchema& key, const nlohmann::ordered_json& object);

/// The object of a block. Keys that another one excludes or does not allow are left out, whatever the block holds.
template <class Block>
[[nodiscard]] nlohmann::ordered_json fields_document(const Block& block, const FieldTable<Block>& fields,
                                                     const Writing& at = {no_job()}) {
    auto object = nlohmann::ordered_json::object();
    visit_fields(fields, &Field<Block>::write_after, [&](const Field<Block>& one) {
        if (!may_be_written(one.key, object)) return;
        if (auto value = one.write(block, at); !value.is_discarded()) object[one.key.key] = std::move(value);
    });
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

}  // namespace orbid::apps
