#pragma once

#include <functional>
#include <optional>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include <nlohmann/json.hpp>

#include "apps/documents/json_reader.hpp"
#include "apps/documents/schema.hpp"

namespace orbid::apps {

/// A key of a job that is one member of a struct: what the schema says of it, how it is read, how it is written.
template <class Block>
struct Field {
    KeySchema key;
    std::function<void(ObjectReader& object, Block& block)> read;
    std::function<void(const Block& block, nlohmann::ordered_json& object)> write;
};

/// The keys of a block in the order of the schema and of job.json.
template <class Block>
using FieldTable = std::vector<Field<Block>>;

/// A number, truth value or text whose default is not a fixed one, or that has none. An optional one is written where
/// it is there.
template <class Block, class Value>
[[nodiscard]] Field<Block> open_field(KeySchema key, Value Block::*member) {
    const std::string name = key.key;
    return {std::move(key), [name, member](ObjectReader& object, Block& block) { object.read(name, block.*member); },
            [name, member](const Block& block, nlohmann::ordered_json& object) {
                if constexpr (std::is_same_v<Value, std::optional<double>>) {
                    if (block.*member) object[name] = *(block.*member);
                } else {
                    object[name] = block.*member;
                }
            }};
}

/// The same with the default of the struct.
template <class Block, class Value>
[[nodiscard]] Field<Block> field(KeySchema key, Value Block::*member) {
    if constexpr (std::is_same_v<Value, std::string>) {
        key.by_default((Block{}.*member).c_str());
    } else {
        key.by_default(Block{}.*member);
    }
    return open_field(std::move(key), member);
}

/// One of several names, in the order of the enumeration.
template <class Block, class Enum>
[[nodiscard]] Field<Block> choice_field(const std::string& name, const std::vector<std::string>& names,
                                        std::string text, Enum Block::*member) {
    KeySchema key = describe::key(name, describe::choice(names), std::move(text));
    key.by_default(names[static_cast<std::size_t>(Block{}.*member)].c_str());
    return {std::move(key),
            [name, &names, member](ObjectReader& object, Block& block) { object.choose(name, names, block.*member); },
            [name, &names, member](const Block& block, nlohmann::ordered_json& object) {
                object[name] = names[static_cast<std::size_t>(block.*member)];
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
void read_fields(ObjectReader& object, const FieldTable<Block>& fields, Block& block) {
    for (const Field<Block>& one : fields)
        one.read(object, block);
}

template <class Block>
void write_fields(const Block& block, const FieldTable<Block>& fields, nlohmann::ordered_json& object) {
    for (const Field<Block>& one : fields)
        one.write(block, object);
}

/// The object of a block that has these fields alone.
template <class Block>
[[nodiscard]] nlohmann::ordered_json fields_document(const Block& block, const FieldTable<Block>& fields) {
    auto object = nlohmann::ordered_json::object();
    write_fields(block, fields, object);
    return object;
}

}  // namespace orbid::apps
