# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Messages of Foxglove (protobuf), read by the schema that comes with them."""

from collections.abc import Iterable
from typing import Any

import pytest


def decoded(schema: Any, messages: Iterable[bytes]) -> list[Any]:  # noqa: ANN401
    """Messages of a schema that has a name and the files of its definition."""
    descriptor_pb2 = pytest.importorskip('google.protobuf.descriptor_pb2')
    from google.protobuf import descriptor_pool, message_factory

    pool = descriptor_pool.DescriptorPool()
    for file in descriptor_pb2.FileDescriptorSet.FromString(schema.data).file:
        pool.Add(file)
    kind = message_factory.GetMessageClass(pool.FindMessageTypeByName(schema.name))
    return [kind.FromString(data) for data in messages]
